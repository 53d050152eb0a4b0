// SPDX-License-Identifier: Apache-2.0
// COLMAP: a model in sparse/0, sparse or the folder itself, and the frames. An image "cam/0.jpg" of
// the model is camera "cam" (folders below that become "a_b"), an image "cam.jpg" is camera "cam";
// the camera's frames are the pictures of images/cam/ or the video images/cam.* or videos/cam.*.
// Several images of a camera in the model must have one pose, as far as COLMAP is exact.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>

#include "capture_files.h"
#include "colmap_model.h"

namespace stgs::encoder {
namespace {

namespace fs = std::filesystem;

// How much two images of a standing camera may differ after bundle adjustment.
constexpr double kPoseRotation = 0.01;  // radians
constexpr double kPosePosition = 0.01;  // of the cameras' extent

// COLMAP's parameters, as focal lengths, centre and OpenCV's coefficients.
Status set_lens(const ColmapCamera& from, const std::string& where, SourceCamera& camera) {
  const std::vector<double>& p = from.params;
  const bool one_focal =
      from.model == "SIMPLE_PINHOLE" || from.model == "SIMPLE_RADIAL" || from.model == "RADIAL";
  const bool two_focal = from.model == "PINHOLE" || from.model == "OPENCV" ||
                         from.model == "OPENCV_FISHEYE" || from.model == "FULL_OPENCV";
  if (!one_focal && !two_focal) {
    return unsupported(
        "{}: the camera model {} is not supported; let COLMAP use OPENCV, or "
        "undistort first",
        where, from.model);
  }
  const std::size_t at = one_focal ? 1 : 2;
  const std::vector<double> k = {p[0], 0, p[at], 0, p[at - 1], p[at + 1], 0, 0, 1};
  STGS_TRY(set_intrinsics(k, 0.5, where, camera));
  std::vector<double> distortion(p.begin() + static_cast<std::ptrdiff_t>(at) + 2, p.end());
  if (one_focal) distortion.resize(4);  // k1 [k2], no tangential part
  STGS_TRY(set_distortion(distortion, from.model == "OPENCV_FISHEYE", where, camera));
  if (from.width == 0 || from.height == 0 || from.width > 32768 || from.height > 32768) {
    return invalid_file("{}: {}x{} is no size of a picture", where, from.width, from.height);
  }
  camera.width = static_cast<int>(from.width);
  camera.height = static_cast<int>(from.height);
  return {};
}

Status set_rotation(const ColmapImage& image, const std::string& where, SourceCamera& camera) {
  const auto [w0, x0, y0, z0] = image.rotation;
  const double length = std::sqrt(w0 * w0 + x0 * x0 + y0 * y0 + z0 * z0);
  if (!(length > 1e-6 && std::isfinite(length))) {
    return invalid_file("{}: image '{}' has no rotation", where, image.name);
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

bool find_camera_frames(const std::string& folder, const std::string& image, SourceCamera& camera) {
  const fs::path path(image);
  const std::string name =
      path.has_parent_path() ? path.parent_path().generic_string() : stem_of(image);
  return find_frames(folder + "/images", name, camera) ||
         find_frames(folder + "/videos", name, camera) || find_frames(folder, name, camera);
}

// Images of a camera after its first one must have its pose.
Status check_still(const SourceCapture& capture,
                   const std::vector<std::pair<std::size_t, SourceCamera>>& others,
                   const std::string& where) {
  double extent = 0;
  for (const SourceCamera& a : capture.cameras) {
    extent = std::max(extent, cv::norm(centre_of(a) - centre_of(capture.cameras.front())));
  }
  for (const auto& [index, other] : others) {
    const SourceCamera& camera = capture.cameras[index];
    const cv::Matx33d turn = cv::Matx33d(camera.rotation).t() * cv::Matx33d(other.rotation);
    const double angle = std::acos(std::clamp((cv::trace(turn) - 1) / 2, -1.0, 1.0));
    const double moved = cv::norm(centre_of(camera) - centre_of(other));
    if (angle <= kPoseRotation && moved <= kPosePosition * extent) continue;
    return unsupported(
        "{}: camera '{}' moves (image '{}' has another pose than its first image); "
        "only cameras that stand still can be prepared",
        where, camera.name, other.name);
  }
  return {};
}

}  // namespace

std::string colmap_model_folder(const std::string& folder) {
  for (const char* below : {"/sparse/0", "/sparse", ""}) {
    if (is_colmap_model(folder + below)) return folder + below;
  }
  return "";
}

Status cameras_from_colmap(const ColmapModel& model, const std::string& where,
                           SourceCapture& capture, std::vector<std::string>* first_images) {
  std::vector<std::pair<std::size_t, SourceCamera>> others;
  for (const ColmapImage& image : model.images) {
    const auto it = model.cameras.find(image.camera);
    if (it == model.cameras.end()) {
      return invalid_file("{}: image '{}' has camera {}, which the model lacks", where, image.name,
                          image.camera);
    }
    SourceCamera camera;
    camera.name = camera_name(image.name);
    STGS_TRY(set_rotation(image, where, camera));
    const auto known = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                    [&](const SourceCamera& c) { return c.name == camera.name; });
    if (known != capture.cameras.end()) {
      camera.name = image.name;
      others.emplace_back(known - capture.cameras.begin(), camera);
      continue;
    }
    const std::string here = fmt::format("{}: camera {} ('{}')", where, image.camera, camera.name);
    STGS_TRY(set_lens(it->second, here, camera));
    capture.cameras.push_back(std::move(camera));
    if (first_images != nullptr) first_images->push_back(image.name);
  }
  return check_still(capture, others, where);
}

Result<SourceCapture> load_colmap(const std::string& folder) {
  const std::string where = colmap_model_folder(folder);
  if (where.empty()) {
    return io_error(
        "{}: has no COLMAP model; looked for cameras and images (.bin or .txt) in "
        "sparse/0, sparse and the folder itself",
        folder);
  }
  STGS_ASSIGN(ColmapModel model, read_colmap_model(where));
  SourceCapture capture;
  std::vector<std::string> images;
  STGS_TRY(cameras_from_colmap(model, where, capture, &images));
  for (std::size_t i = 0; i < images.size(); ++i) {
    SourceCamera& camera = capture.cameras[i];
    if (!find_camera_frames(folder, images[i], camera)) {
      return io_error(
          "{}: camera '{}' (image '{}' of the model) has no frames; looked for a folder "
          "or video of its name in images/, videos/ and the folder itself",
          folder, camera.name, images[i]);
    }
  }
  capture.points = std::move(model.points);
  return capture;
}

}  // namespace stgs::encoder
