// SPDX-License-Identifier: Apache-2.0
// Layout "panoptic": CMU Panoptic as in Dynamic 3D Gaussians, at 30 fps.
//   train_meta.json, test_meta.json: w and h; for every frame a list of cameras with k (3x3),
//   w2c (4x4), fn (image below ims/) and cam_id.
//   seg/ has one foreground mask per image.
// The cameras of test_meta.json are held out.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "capture_files.h"
#include "json_error.h"
#include "json_read.h"
#include "natural_order.h"
#include "plural.h"
#include "stgs/format/camera.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr int kMaxCameraNumber = 1'000'000'000;

bool same(const std::vector<double>& a, const std::vector<double>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](double x, double y) { return std::abs(x - y) <= 1e-6 * (1 + std::abs(x)); });
}

// One image of one camera in the tables.
struct Entry {
  std::string camera, image;
  std::vector<double> k, w2c;
};

Result<Entry> read_entry(const Json& meta, std::size_t frame, std::size_t index,
                         const std::string& where) {
  Entry entry;
  const Json& id = meta.at("cam_id").at(frame).at(index);
  if (id.is_string()) {
    entry.camera = id.get<std::string>();
  } else {
    STGS_ASSIGN(const int number, exact_value<int>(id, 0, kMaxCameraNumber, "cam_id", where));
    entry.camera = std::to_string(number);
  }
  entry.image = meta.at("fn").at(frame).at(index).get<std::string>();
  const std::string here = fmt::format("{}: camera '{}' frame {}", where, entry.camera, frame);
  STGS_ASSIGN(entry.k, json_numbers(meta.at("k").at(frame).at(index), here + ": k"));
  STGS_ASSIGN(entry.w2c, json_numbers(meta.at("w2c").at(frame).at(index), here + ": w2c"));
  return entry;
}

Status add_mask(const CaptureFolder& files, const std::string& image, SourceCamera& camera) {
  const std::string folder = files.path();
  const std::string path = folder + "/seg/" + fs::path(image).replace_extension(".png").string();
  const std::size_t frame = camera.images.size() - 1;
  if (files.exists(path)) {
    camera.masks.push_back(path);
  } else if (!camera.masks.empty()) {
    return io_error(
        "{}: no mask for camera '{}' frame {}, though earlier frames have one; add it, or remove "
        "seg/ to have masks computed",
        path, camera.name, frame);
  }
  if (!camera.masks.empty() && camera.masks.size() != frame + 1) {
    return io_error(
        "{}/seg: camera '{}' has a mask for frame {} but none for frame 0; add it, or "
        "remove seg/ to have masks computed",
        folder, camera.name, frame);
  }
  return {};
}

// Appends the image of a frame, and its mask.
Status add_image(const CaptureFolder& files, const std::string& image, const std::string& table,
                 SourceCamera& camera) {
  STGS_ASSIGN(std::string path, files.path_of("ims/" + image, table + ": fn"));
  // Also seg/ is named by `image`.
  STGS_TRY(files.path_of(image, table + ": fn").status());
  camera.images.push_back(std::move(path));
  return add_mask(files, image, camera);
}

Status read_meta(const CaptureFolder& files, const std::string& name, bool test,
                 SourceCapture& capture) {
  const std::string path = files.path() + "/" + name;
  STGS_ASSIGN(const Json meta, read_json(files, path));
  try {
    std::map<std::string, std::size_t> known;
    std::vector<Entry> first;
    const std::size_t begin = capture.cameras.size();
    STGS_TRY(check_frame_limit(meta.at("fn").size(), path));
    for (std::size_t frame = 0; frame < meta.at("fn").size(); ++frame) {
      const std::size_t cameras = meta.at("fn").at(frame).size();
      STGS_TRY(check_camera_limit(cameras, path));
      for (std::size_t i = 0; i < cameras; ++i) {
        STGS_ASSIGN(Entry entry, read_entry(meta, frame, i, path));
        if (frame == 0) {
          SourceCamera camera;
          camera.name = entry.camera;
          STGS_ASSIGN(camera.width, exact<int>(meta, "w", 1, kMaxImageSide, path));
          STGS_ASSIGN(camera.height, exact<int>(meta, "h", 1, kMaxImageSide, path));
          camera.test = test;
          STGS_TRY(set_intrinsics(entry.k, 0.5, path + ": camera '" + entry.camera + "'", camera));
          STGS_TRY(set_pose(entry.w2c, path + ": camera '" + entry.camera + "'", camera));
          known.emplace(entry.camera, capture.cameras.size());
          capture.cameras.push_back(camera);
          first.push_back(entry);
        }
        const auto it = known.find(entry.camera);
        if (it == known.end()) {
          return invalid_file("{}: camera '{}' appears in frame {} but not in frame 0", path,
                              entry.camera, frame);
        }
        const Entry& origin = first[it->second - begin];
        if (!same(origin.k, entry.k) || !same(origin.w2c, entry.w2c)) {
          return unsupported(
              "{}: camera '{}' moves or zooms (frame {} differs from frame 0); only static cameras "
              "are supported",
              path, entry.camera, frame);
        }
        SourceCamera& camera = capture.cameras[it->second];
        if (camera.images.size() != frame) {
          return invalid_file("{}: camera '{}' has {} in frames 0 to {} (expected one per frame)",
                              path, camera.name, plural(camera.images.size() + 1, "image"), frame);
        }
        STGS_TRY(add_image(files, entry.image, path, camera));
      }
    }
  } catch (const Json::exception& error) {
    return invalid_file("{}: {}", path, json_error(error));
  }
  return {};
}

}  // namespace

Result<SourceCapture> load_panoptic(const CaptureFolder& files) {
  SourceCapture capture;
  capture.fps = 30;
  STGS_TRY(read_meta(files, "train_meta.json", false, capture));
  if (files.exists(files.path() + "/test_meta.json")) {
    STGS_TRY(read_meta(files, "test_meta.json", true, capture));
    capture.split_known = true;
  }
  std::sort(
      capture.cameras.begin(), capture.cameras.end(),
      [](const SourceCamera& a, const SourceCamera& b) { return natural_less(a.name, b.name); });
  return capture;
}

}  // namespace stgs::encoder
