// SPDX-License-Identifier: Apache-2.0
// Layout "nerfstudio": transforms.json with OpenGL camera-to-world matrices. Intrinsics are at the
// top level or in the entries of "frames". Entries become static cameras as follows:
//   - An entry whose file_path is a video is one camera, named after the file.
//   - Images with the same "camera" (or "camera_label") are one camera of that name. They must have
//     the same pose.
//   - Unlabelled images with the same pose and intrinsics are one camera. It is named after their
//     folder if that holds no images of other cameras, else "cam00", "cam01", ...
//   - Images of a camera are ordered by "time" if all have it, else by name. Cameras with times
//   must
//     have the same times. Images without times in a folder of their own are numbered by name.
//   - "fps" is used if present. Cameras named by "test_filenames" are held out.
//   - "mask_path" marks valid pixels, not motion, and is ignored, as is masks/ if it points there.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>
#include <set>

#include "capture_files.h"
#include "json_error.h"
#include "natural_order.h"
#include "plural.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

struct TimedImage {
  std::string path;
  double time = 0;
  bool timed = false;
};

struct Group {
  SourceCamera camera;
  std::string label;
  std::vector<TimedImage> images;
  bool own_folder = false;  // the folder holds no images of other cameras
};

// Returns a number of the entry, else of the top level, else `otherwise`.
double number(const Json& entry, const Json& top, const char* key, double otherwise) {
  if (entry.contains(key)) return entry.at(key).get<double>();
  return top.value(key, otherwise);
}

Status set_lens(const Json& entry, const Json& top, const std::string& where,
                SourceCamera& camera) {
  const double nan = std::nan("");
  const double width = number(entry, top, "w", 0), height = number(entry, top, "h", 0);
  STGS_TRY(set_size(width, height, where + ": w and h", camera));
  double fx = number(entry, top, "fl_x", nan);
  const double angle = number(entry, top, "camera_angle_x", nan);
  if (std::isnan(fx) && angle > 0 && angle < 3.1415) fx = 0.5 * width / std::tan(0.5 * angle);
  if (std::isnan(fx)) return invalid_file("{}: fl_x or camera_angle_x is missing", where);
  const double fy = number(entry, top, "fl_y", fx);
  const double cx = number(entry, top, "cx", 0.5 * width);
  const double cy = number(entry, top, "cy", 0.5 * height);
  STGS_TRY(set_intrinsics({fx, 0, cx, 0, fy, cy, 0, 0, 1}, 0.5, where, camera));
  const std::string model = entry.value("camera_model", top.value("camera_model", "OPENCV"));
  const bool fisheye = model == "OPENCV_FISHEYE";
  if (!fisheye && model != "OPENCV" && model != "PINHOLE" && model != "SIMPLE_PINHOLE") {
    return unsupported(
        "{}: unsupported camera model {} (expected OPENCV, OPENCV_FISHEYE or PINHOLE)", where,
        model);
  }
  const auto coefficient = [&](const char* key) { return number(entry, top, key, 0); };
  if (model == "PINHOLE" || model == "SIMPLE_PINHOLE") return {};
  if (fisheye) {
    return set_distortion(
        {coefficient("k1"), coefficient("k2"), coefficient("k3"), coefficient("k4")}, true, where,
        camera);
  }
  return set_distortion({coefficient("k1"), coefficient("k2"), coefficient("p1"), coefficient("p2"),
                         coefficient("k3")},
                        false, where, camera);
}

Result<SourceCamera> read_camera(const Json& entry, const Json& top, const std::string& where) {
  SourceCamera camera;
  STGS_TRY(set_lens(entry, top, where, camera));
  STGS_ASSIGN(std::vector<double> c2w,
              json_numbers(entry.at("transform_matrix"), where + ": transform_matrix"));
  if (c2w.size() != 12 && c2w.size() != 16) {
    return invalid_file("{}: transform_matrix has {} (expected 4x4)", where,
                        plural(c2w.size(), "number"));
  }
  for (int row = 0; row < 3; ++row) {  // OpenGL: y up, z backward
    c2w[4 * row + 1] = -c2w[4 * row + 1];
    c2w[4 * row + 2] = -c2w[4 * row + 2];
  }
  STGS_TRY(set_pose_from_camera_to_world(c2w, where, camera));
  return camera;
}

bool near(double a, double b) {
  return std::abs(a - b) <= 1e-6 * (1 + std::abs(a));
}

bool same_camera(const SourceCamera& a, const SourceCamera& b) {
  return near(a.fx, b.fx) && near(a.fy, b.fy) && near(a.cx, b.cx) && near(a.cy, b.cy) &&
         a.distortion == b.distortion && std::equal(a.rotation, a.rotation + 9, b.rotation, near) &&
         std::equal(a.translation, a.translation + 3, b.translation, near);
}

Result<std::string> label_of(const Json& entry, const std::string& where) {
  for (const char* key : {"camera", "camera_label"}) {
    if (!entry.contains(key)) continue;
    const Json& label = entry.at(key);
    if (label.is_string()) return label.get<std::string>();
    if (label.is_number()) return label.dump();
    return invalid_file("{}: {}: expected a name or a number, got {}", where, key,
                        short_json(label));
  }
  return std::string();
}

// Returns the group of an image; groups.end() if it is the first. The limit of cameras bounds the
// search.
std::vector<Group>::iterator find_group(std::vector<Group>& groups, const std::string& label,
                                        const SourceCamera& camera) {
  return std::find_if(groups.begin(), groups.end(), [&](const Group& g) {
    return g.camera.video.empty() && g.label == label &&
           (!label.empty() || same_camera(g.camera, camera));
  });
}

Status add_entry(const Json& entry, const Json& top, const CaptureFolder& files,
                 std::vector<Group>& groups) {
  const std::string table = files.path() + "/transforms.json";
  const std::string file = entry.at("file_path").get<std::string>();
  STGS_ASSIGN(const std::string path, files.path_of(file, table + ": file_path"));
  const std::string where = fmt::format("{}: frame '{}'", table, file);
  STGS_ASSIGN(SourceCamera camera, read_camera(entry, top, where));
  if (is_video(path)) {
    camera.video = path;
    groups.push_back({camera, stem_of(path), {}, false});
    return check_camera_limit(groups.size(), table);
  }
  STGS_ASSIGN(const std::string label, label_of(entry, where));
  auto group = find_group(groups, label, camera);
  if (group == groups.end()) {
    groups.push_back({camera, label, {}, false});
    STGS_TRY(check_camera_limit(groups.size(), table));
    group = std::prev(groups.end());
  }
  if (!same_camera(group->camera, camera)) {
    return unsupported(
        "{}: camera '{}' moves or zooms (this entry differs from its first); only static cameras "
        "are supported",
        where, label);
  }
  TimedImage image{path, 0, entry.contains("time")};
  if (image.timed) image.time = entry.at("time").get<double>();
  group->images.push_back(image);
  return {};
}

void name_groups(std::vector<Group>& groups) {
  std::map<std::string, int> folders;
  const auto folder_of = [](const Group& group) {
    const fs::path first = fs::path(group.images.front().path).parent_path();
    for (const TimedImage& image : group.images) {
      if (fs::path(image.path).parent_path() != first) return std::string();
    }
    return first.filename().string();
  };
  for (const Group& group : groups) {
    if (!group.images.empty()) ++folders[folder_of(group)];
  }
  for (std::size_t i = 0; i < groups.size(); ++i) {
    Group& group = groups[i];
    group.camera.name = group.label;
    if (group.images.empty()) continue;
    const std::string folder = folder_of(group);
    group.own_folder = !folder.empty() && folders[folder] == 1;
    if (!group.label.empty()) continue;
    group.camera.name = group.own_folder ? folder : fmt::format("cam{:02}", i);
  }
}

// Orders the images. kInvalidFile if the times of a camera differ from those of the first.
Status order_images(const std::string& folder, std::vector<Group>& groups) {
  const Group* first = nullptr;
  for (Group& group : groups) {
    const bool timed = std::all_of(group.images.begin(), group.images.end(),
                                   [](const TimedImage& p) { return p.timed; });
    std::sort(group.images.begin(), group.images.end(),
              [&](const TimedImage& a, const TimedImage& b) {
                return timed && a.time != b.time ? a.time < b.time : natural_less(a.path, b.path);
              });
    for (const TimedImage& image : group.images) group.camera.images.push_back(image.path);
    group.camera.numbered = !timed && group.own_folder;
    if (!timed || group.images.empty()) continue;
    if (first == nullptr) first = &group;
    const std::size_t common = std::min(first->images.size(), group.images.size());
    for (std::size_t i = 0; i < common; ++i) {
      if (near(first->images[i].time, group.images[i].time)) continue;
      return invalid_file(
          "{}: the cameras are not synchronised: frame {} of camera '{}' ({}) is at time {}, of "
          "camera '{}' at time {}; captures with a moving camera are not supported",
          folder, i, group.camera.name, group.images[i].path, group.images[i].time,
          first->camera.name, first->images[i].time);
    }
  }
  return {};
}

// Holds out the cameras that have a file of the list.
Status hold_out(const Json& names, const CaptureFolder& files, const std::string& table,
                std::vector<SourceCamera>& cameras) {
  std::set<std::string> held_out;
  for (const Json& name : names) {
    STGS_ASSIGN(std::string path,
                files.path_of(name.get<std::string>(), table + ": test_filenames"));
    held_out.insert(std::move(path));
  }
  const auto listed = [&](const std::string& path) { return held_out.count(path) != 0; };
  for (SourceCamera& camera : cameras) {
    camera.test =
        listed(camera.video) || std::any_of(camera.images.begin(), camera.images.end(), listed);
  }
  return {};
}

}  // namespace

Result<SourceCapture> load_nerfstudio(const CaptureFolder& files, const LogSink& log) {
  const std::string path = files.path() + "/transforms.json";
  STGS_ASSIGN(const Json top, read_json(files, path));
  try {
    std::vector<Group> groups;
    SourceCapture capture;
    bool masks = false;
    for (const Json& entry : top.at("frames")) {
      STGS_TRY(add_entry(entry, top, files, groups));
      if (!entry.contains("mask_path")) continue;
      masks = true;
      const fs::path mask = fs::path(entry.at("mask_path").get<std::string>()).lexically_normal();
      capture.masks_are_not_motion |= !mask.empty() && *mask.begin() == "masks";
    }
    if (masks) log(1, path + ": mask_path marks valid pixels, not motion; ignored");
    name_groups(groups);
    STGS_TRY(order_images(files.path(), groups));
    capture.fps = top.value("fps", 0.0);
    for (Group& group : groups) capture.cameras.push_back(std::move(group.camera));
    capture.split_known = top.contains("test_filenames");
    STGS_TRY(hold_out(top.value("test_filenames", Json::array()), files, path, capture.cameras));
    return capture;
  } catch (const Json::exception& error) {
    return invalid_file("{}: {}", path, json_error(error));
  }
}

}  // namespace stgs::encoder
