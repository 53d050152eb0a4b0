// SPDX-License-Identifier: Apache-2.0
// OpenCV FileStorage (YAML, JSON or XML), one file per camera. The first key that exists is used:
//   camera matrix   camera_matrix, Camera_Matrix, cameraMatrix, K, M
//   distortion      distortion_coefficients, Distortion_Coefficients, dist_coeffs, distCoeffs,
//                   dist, D
//   rotation        R, rotation, rotation_matrix, rvec (3x3, or a rotation vector)
//   translation     T, t, translation, translation_vector, tvec
//   size            image_width and image_height, image_Width and image_Height, width and height
//   fisheye         fisheye_model, fisheye
// The pose is world to camera.
#include <algorithm>

#include "calibration.h"
#include "capture_files.h"
#include "opencv_storage.h"

namespace stgs::encoder {
namespace {

using Keys = std::vector<std::string>;

const Keys kMatrix = {"camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "M"};
const Keys kDistortion = {
    "distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "dist", "D"};
const Keys kRotation = {"R", "rotation", "rotation_matrix", "rvec"};
const Keys kTranslation = {"T", "t", "translation", "translation_vector", "tvec"};
const Keys kWidth = {"image_width", "image_Width", "width"};
const Keys kHeight = {"image_height", "image_Height", "height"};
const Keys kFisheye = {"fisheye_model", "fisheye"};

bool has_any(const Storage& file, const Keys& keys) {
  return std::any_of(keys.begin(), keys.end(),
                     [&](const std::string& key) { return !file[key].empty(); });
}

// Returns an optional number, 0 if it is missing.
Result<double> number(const Storage& file, const Keys& keys) {
  STGS_ASSIGN(const std::vector<double> values, file.numbers(keys));
  if (values.size() > 1) return invalid_file("{}: {} is not a number", file.path(), keys.front());
  return values.empty() ? 0.0 : values[0];
}

Status set_file_size(const Storage& file, SourceCamera& camera) {
  STGS_ASSIGN(const double width, number(file, kWidth));
  STGS_ASSIGN(const double height, number(file, kHeight));
  return width == 0 && height == 0 ? Status() : set_size(width, height, file.path(), camera);
}

Result<Calibration> read_file(const Storage& file, const std::string& name) {
  const std::string& path = file.path();
  Calibration calibration;
  if (!has_any(file, kMatrix) || !has_any(file, kRotation) || !has_any(file, kTranslation)) {
    return calibration;
  }
  SourceCamera& camera = calibration.cameras.emplace_back();
  camera.name = name;
  STGS_ASSIGN(const std::vector<double> matrix, file.numbers(kMatrix));
  STGS_TRY(set_intrinsics(matrix, 0, path, camera));
  STGS_ASSIGN(std::vector<double> lens, file.numbers(kDistortion));
  STGS_ASSIGN(const double fisheye, number(file, kFisheye));
  STGS_TRY(set_distortion(std::move(lens), fisheye != 0, path, camera));
  STGS_ASSIGN(const std::vector<double> rotation, file.numbers(kRotation));
  STGS_ASSIGN(const std::vector<double> translation, file.numbers(kTranslation));
  STGS_TRY(set_opencv_pose(rotation, translation, path, camera));
  STGS_TRY(set_file_size(file, camera));
  return calibration;
}

}  // namespace

Result<Calibration> read_opencv_camera(const CaptureFolder& files, const std::string& path,
                                       const std::string& name) {
  STGS_ASSIGN(const Storage file, Storage::open(files, path));
  try {
    return read_file(file, name);
  } catch (const cv::Exception& error) {  // a list in place of keys, for example
    return invalid_file("{}: not a calibration of OpenCV: {}", path, error.err);
  }
}

}  // namespace stgs::encoder
