// SPDX-License-Identifier: Apache-2.0
// Layout "colmap": a model in sparse/0, sparse or the folder itself, and the frames.
//   - Image "cam/0.jpg" of the model belongs to camera "cam". Deeper folders are joined:
//   "a/b/0.jpg"
//     belongs to "a_b". Image "cam.jpg" is camera "cam".
//   - The frames of a camera are the images in images/cam/, or the video images/cam.* or
//     videos/cam.*.
//   - All images of a camera must have the same pose, within the accuracy of COLMAP.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>

#include "capture_files.h"
#include "colmap_model.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// The largest pose difference between two images of a static camera after bundle adjustment.
constexpr double kMaxPoseRotation = 0.01;  // radians
constexpr double kMaxPoseShift = 0.01;     // fraction of the extent of the cameras

// Converts COLMAP parameters to focal lengths, principal point and OpenCV coefficients.
Status set_lens(const ColmapCamera& from, const std::string& where, SourceCamera& camera) {
  const std::vector<double>& p = from.params;
  const bool one_focal =
      from.model == "SIMPLE_PINHOLE" || from.model == "SIMPLE_RADIAL" || from.model == "RADIAL";
  const bool two_focal = from.model == "PINHOLE" || from.model == "OPENCV" ||
                         from.model == "OPENCV_FISHEYE" || from.model == "FULL_OPENCV";
  if (!one_focal && !two_focal) {
    return unsupported(
        "{}: unsupported camera model {}; run COLMAP with --ImageReader.camera_model OPENCV, or "
        "undistort the images first",
        where, from.model);
  }
  const std::size_t at = one_focal ? 1 : 2;
  const std::vector<double> k = {p[0], 0, p[at], 0, p[at - 1], p[at + 1], 0, 0, 1};
  STGS_TRY(set_intrinsics(k, 0.5, where, camera));
  std::vector<double> distortion(p.begin() + static_cast<std::ptrdiff_t>(at) + 2, p.end());
  if (one_focal) distortion.resize(4);  // k1 [k2], no tangential part
  STGS_TRY(set_distortion(distortion, from.model == "OPENCV_FISHEYE", where, camera));
  return set_size(static_cast<double>(from.width), static_cast<double>(from.height), where, camera);
}

Status set_rotation(const ColmapImage& image, const std::string& where, SourceCamera& camera) {
  const auto [w0, x0, y0, z0] = image.rotation;
  const double length = std::sqrt(w0 * w0 + x0 * x0 + y0 * y0 + z0 * z0);
  if (!(length > 1e-6 && std::isfinite(length))) {
    return invalid_file("{}: image '{}' has an invalid rotation (zero or non-finite quaternion)",
                        where, image.name);
  }
  const double w = w0 / length, x = x0 / length, y = y0 / length, z = z0 / length;
  const double rotation[9] = {
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
      2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
      2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  std::copy_n(rotation, 9, camera.rotation);
  std::copy(image.translation.begin(), image.translation.end(), camera.translation);
  return {};
}

std::string camera_name(const std::string& image) {
  const fs::path path(image);
  std::string name = path.has_parent_path() ? path.parent_path().generic_string() : stem_of(image);
  std::replace(name.begin(), name.end(), '/', '_');
  return name;
}

cv::Vec3d centre_of(const SourceCamera& camera) {
  return -(cv::Matx33d(camera.rotation).t() * cv::Vec3d(camera.translation));
}

Result<bool> find_camera_frames(const CaptureFolder& files, const std::string& image,
                                const std::string& model, SourceCamera& camera) {
  STGS_TRY(files.path_of(image, model + ": image name").status());
  const fs::path path(image);
  const std::string name =
      path.has_parent_path() ? path.parent_path().generic_string() : stem_of(image);
  for (const char* below : {"/images", "/videos", ""}) {
    STGS_ASSIGN(const bool found, find_frames(files, files.path() + below, name, camera));
    if (found) return true;
  }
  return false;
}

// Checks that the remaining images of every camera have the pose of its first image.
Status check_static(const SourceCapture& capture,
                    const std::vector<std::pair<std::size_t, SourceCamera>>& others,
                    const std::string& where) {
  double extent = 0;
  for (const SourceCamera& a : capture.cameras) {
    extent = std::max(extent, cv::norm(centre_of(a) - centre_of(capture.cameras.front())));
  }
  for (const auto& [index, other] : others) {
    const SourceCamera& camera = capture.cameras[index];
    const cv::Matx33d rotation = cv::Matx33d(camera.rotation).t() * cv::Matx33d(other.rotation);
    const double angle = std::acos(std::clamp((cv::trace(rotation) - 1) / 2, -1.0, 1.0));
    const double shift = cv::norm(centre_of(camera) - centre_of(other));
    if (angle <= kMaxPoseRotation && shift <= kMaxPoseShift * extent) continue;
    return unsupported(
        "{}: camera '{}' moves (image '{}' differs in pose from its first image); only static "
        "cameras are supported",
        where, camera.name, other.name);
  }
  return {};
}

}  // namespace

std::string colmap_model_folder(const CaptureFolder& files) {
  for (const char* below : {"/sparse/0", "/sparse", ""}) {
    if (is_colmap_model(files, files.path() + below)) return files.path() + below;
  }
  return "";
}

Status cameras_from_colmap(const ColmapModel& model, const std::string& where,
                           SourceCapture& capture, std::vector<std::string>* first_images) {
  std::vector<std::pair<std::size_t, SourceCamera>> others;
  std::map<std::string, std::size_t> index_of;  // by name
  for (const ColmapImage& image : model.images) {
    const auto it = model.cameras.find(image.camera);
    if (it == model.cameras.end()) {
      return invalid_file("{}: image '{}' refers to camera {}, which is not in the model", where,
                          image.name, image.camera);
    }
    SourceCamera camera;
    camera.name = camera_name(image.name);
    STGS_TRY(set_rotation(image, where, camera));
    const auto [known, added] = index_of.emplace(camera.name, capture.cameras.size());
    if (!added) {
      camera.name = image.name;
      others.emplace_back(known->second, camera);
      continue;
    }
    STGS_TRY(check_camera_limit(index_of.size(), where));
    const std::string here = fmt::format("{}: camera {} ('{}')", where, image.camera, camera.name);
    STGS_TRY(set_lens(it->second, here, camera));
    capture.cameras.push_back(std::move(camera));
    if (first_images != nullptr) first_images->push_back(image.name);
  }
  return check_static(capture, others, where);
}

Result<SourceCapture> load_colmap(const CaptureFolder& files) {
  const std::string& folder = files.path();
  const std::string where = colmap_model_folder(files);
  if (where.empty()) {
    return io_error(
        "{}: no COLMAP model found (looked for cameras and images, .bin or .txt, in sparse/0, "
        "sparse and the folder itself)",
        folder);
  }
  STGS_ASSIGN(ColmapModel model, read_colmap_model(files, where));
  SourceCapture capture;
  std::vector<std::string> images;
  STGS_TRY(cameras_from_colmap(model, where, capture, &images));
  for (std::size_t i = 0; i < images.size(); ++i) {
    SourceCamera& camera = capture.cameras[i];
    STGS_ASSIGN(const bool found, find_camera_frames(files, images[i], where, camera));
    if (!found) {
      return io_error(
          "{}: no frames for camera '{}' (image '{}' of the model); looked for an image folder or "
          "video of that name in images/, videos/ and the folder itself",
          folder, camera.name, images[i]);
    }
  }
  capture.points = std::move(model.points);
  return capture;
}

}  // namespace stgs::encoder
