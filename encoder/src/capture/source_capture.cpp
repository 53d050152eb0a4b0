// SPDX-License-Identifier: Apache-2.0
#include "source_capture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <set>

#include "capture_files.h"
#include "stgs/format/text.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

struct LayoutEntry {
  Layout layout;
  const char* name;
  const char* looked_for;  // what the layout is recognised by
};
// In the order in which a folder is tried.
constexpr std::array<LayoutEntry, 6> kLayouts = {{
    {Layout::kPanoptic, "panoptic", "train_meta.json"},
    {Layout::kN3dv, "n3dv", "poses_bounds.npy"},
    {Layout::kEasyVolcap, "easyvolcap", "intri.yml and extri.yml"},
    {Layout::kNerfstudio, "nerfstudio", "transforms.json"},
    {Layout::kColmap, "colmap",
     "cameras and images (.bin or .txt) in sparse/0, sparse or the folder itself"},
    {Layout::kVideos, "videos",
     "cameras.json, or at least two videos (or folders of pictures) in the folder itself, in "
     "videos/ or in images/"},
}};

bool recognised(Layout layout, const std::string& folder) {
  const auto has = [&](const char* name) { return fs::exists(folder + "/" + name); };
  switch (layout) {
    case Layout::kPanoptic:
      return has("train_meta.json");
    case Layout::kN3dv:
      return has("poses_bounds.npy");
    case Layout::kEasyVolcap:
      return has("intri.yml") && has("extri.yml");
    case Layout::kNerfstudio:
      return has("transforms.json");
    case Layout::kColmap:
      return !colmap_model_folder(folder).empty();
    case Layout::kVideos:
      return has("cameras.json") || find_cameras(folder).size() >= 2;
    case Layout::kAuto:
      break;
  }
  return false;
}

Result<Layout> detect(const std::string& folder) {
  std::string looked_for;
  for (const LayoutEntry& entry : kLayouts) {
    if (recognised(entry.layout, folder)) return entry.layout;
    looked_for += fmt::format("\n  {}: {}", entry.name, entry.looked_for);
  }
  return usage_error("{}: is not a capture of a known layout. Looked for:{}", folder, looked_for);
}

Result<SourceCapture> load(Layout layout, const std::string& folder,
                           const PrepareSettings& settings, const ProgressSink& progress,
                           const LogSink& log) {
  switch (layout) {
    case Layout::kPanoptic:
      return load_panoptic(folder);
    case Layout::kN3dv:
      return load_n3dv(folder);
    case Layout::kEasyVolcap:
      return load_easyvolcap(folder);
    case Layout::kNerfstudio:
      return load_nerfstudio(folder, log);
    case Layout::kColmap:
      return load_colmap(folder);
    case Layout::kVideos:
      return load_videos(folder, settings.first_frame, progress, log);
    case Layout::kAuto:
      break;
  }
  return usage_error("{}: no layout is chosen", folder);
}

// Refuses what is no rotation, and takes the nearest one for what nearly is.
Status make_rigid(SourceCamera& camera, const std::string& folder) {
  const cv::Matx33d given(camera.rotation);
  cv::Matx33d u, vt;
  cv::Vec3d w;
  for (int i = 0; i < 9; ++i) {
    if (!std::isfinite(given.val[i])) w[0] = -1;
  }
  if (w[0] == 0) cv::SVD::compute(given, w, u, vt);
  const cv::Matx33d rotation = u * vt;
  const bool rigid =
      w[0] < 1.01 && w[2] > 0.99 && cv::determinant(rotation) > 0 &&
      std::isfinite(camera.translation[0] + camera.translation[1] + camera.translation[2]);
  if (!rigid) {
    return invalid_file("{}: the pose of camera '{}' is not a rotation and a translation", folder,
                        camera.name);
  }
  std::copy(rotation.val, rotation.val + 9, camera.rotation);
  return {};
}

Status check(SourceCapture& capture) {
  if (capture.cameras.empty()) return invalid_file("{}: has no cameras", capture.folder);
  std::set<std::string> names;
  for (SourceCamera& camera : capture.cameras) {
    const bool folder_name = !camera.name.empty() && camera.name.front() != '.' &&
                             camera.name.find('/') == std::string::npos;
    if (!folder_name) {
      return invalid_file("{}: '{}' cannot be a camera's folder", capture.folder, camera.name);
    }
    if (!is_utf8(camera.name)) {
      return invalid_file("{}: the camera's name '{}' is not UTF-8; rename its folder or video",
                          capture.folder, camera.name);
    }
    if (!names.insert(camera.name).second) {
      return invalid_file("{}: has two cameras '{}'", capture.folder, camera.name);
    }
    if (camera.video.empty() && camera.images.empty()) {
      return io_error("{}: camera '{}' has no frames", capture.folder, camera.name);
    }
    STGS_TRY(make_rigid(camera, capture.folder));
  }
  return {};
}

bool has_camera(const SourceCapture& capture, const std::string& name) {
  return std::any_of(capture.cameras.begin(), capture.cameras.end(),
                     [&](const SourceCamera& camera) { return camera.name == name; });
}

// A folder of masks or flow that belongs to no camera is a mistake in a name: an error where
// none belongs to one, else a warning.
Status check_names(const SourceCapture& capture, const std::string& folder, bool used,
                   const LogSink& log) {
  if (!used) {
    return invalid_file(
        "{}: holds nothing for any camera (looked for {}/{}/); name its folders as the cameras, "
        "or take it away",
        folder, folder, capture.cameras.front().name);
  }
  for (const std::string& path : list_folders(folder)) {
    const std::string name = fs::path(path).filename().string();
    if (!has_camera(capture, name)) {
      log(1, fmt::format("{}: there is no camera '{}'; not used", path, name));
    }
  }
  return {};
}

// masks/CAMERA/ beside the frames, whatever the layout; they go before the layout's own.
Status take_masks(SourceCapture& capture, const LogSink& log) {
  const std::string folder = capture.folder + "/masks";
  if (!fs::is_directory(folder) || capture.masks_are_not_motion) return {};
  bool used = false;
  for (SourceCamera& camera : capture.cameras) {
    STGS_ASSIGN(const bool found, find_masks(folder, camera.name, camera));
    used |= found;
  }
  return check_names(capture, folder, used, log);
}

Status take_flow(SourceCapture& capture, const LogSink& log) {
  const std::string folder = capture.folder + "/flow";
  if (!fs::is_directory(folder)) return {};
  capture.flow_folder = folder;
  bool used = false;
  for (const SourceCamera& camera : capture.cameras) {
    if (!fs::is_directory(folder + "/" + camera.name)) continue;
    used = true;
    if (camera.lens == LensModel::kPinhole) continue;
    return unsupported(
        "{}/{}: flow is of undistorted frames, but the lens of camera '{}' distorts; undistort "
        "the capture first, or take the folder away to have flow computed",
        folder, camera.name, camera.name);
  }
  return check_names(capture, folder, used, log);
}

// Where the layout names no held-out cameras: the middle one by name, if enough others remain.
void choose_test_camera(SourceCapture& capture, const LogSink& log) {
  constexpr std::size_t kFewest = 4;
  if (capture.split_known || capture.cameras.size() < kFewest) return;
  std::vector<SourceCamera*> sorted;
  for (SourceCamera& camera : capture.cameras) sorted.push_back(&camera);
  std::sort(sorted.begin(), sorted.end(), [](const SourceCamera* a, const SourceCamera* b) {
    return natural_less(a->name, b->name);
  });
  SourceCamera& middle = *sorted[sorted.size() / 2];
  middle.test = true;
  log(2, fmt::format("{}: names no test cameras; the middle one by name, '{}', is held out unless "
                     "others are asked for",
                     capture.folder, middle.name));
}

}  // namespace

const char* layout_name(Layout layout) {
  for (const LayoutEntry& entry : kLayouts) {
    if (entry.layout == layout) return entry.name;
  }
  return "auto";
}

Result<Layout> layout_from_name(const std::string& name) {
  if (name == "auto") return Layout::kAuto;
  std::string known = "auto";
  for (const LayoutEntry& entry : kLayouts) {
    if (name == entry.name) return entry.layout;
    known += fmt::format(", {}", entry.name);
  }
  return usage_error("'{}' is not a layout; known are {}", name, known);
}

Result<SourceCapture> load_source(const std::string& folder, const PrepareSettings& settings,
                                  const ProgressSink& progress, const LogSink& log) {
  if (!fs::exists(folder)) {
    return io_error("{}: does not exist; name the folder that holds the videos or pictures",
                    folder);
  }
  if (!fs::is_directory(folder)) {
    return io_error("{}: is not a folder; name the one that holds the videos or pictures", folder);
  }
  Layout layout = settings.layout;
  if (layout == Layout::kAuto) {
    STGS_ASSIGN(layout, detect(folder));
    log(2, fmt::format("{}: recognised as {}", folder, layout_name(layout)));
  }
  Result<SourceCapture> capture = load(layout, folder, settings, progress, log);
  if (!capture.ok()) return capture;
  capture->layout = layout;
  capture->folder = folder;
  STGS_TRY(check(*capture));
  STGS_TRY(take_masks(*capture, log));
  STGS_TRY(take_flow(*capture, log));
  const bool own_split = settings.default_test_cameras && settings.test_cameras.empty();
  if (own_split) choose_test_camera(*capture, log);
  return capture;
}

}  // namespace stgs::encoder
