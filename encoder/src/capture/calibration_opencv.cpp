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

bool has_any(const cv::FileStorage& file, const Keys& keys) {
  return std::any_of(keys.begin(), keys.end(),
                     [&](const std::string& key) { return !file[key].empty(); });
}

// Returns an optional number, 0 if it is missing.
Result<double> number(const cv::FileStorage& file, const Keys& keys, const std::string& path) {
  STGS_ASSIGN(const std::vector<double> values, storage_numbers(file, keys, path));
  if (values.size() > 1) return invalid_file("{}: {} is not a number", path, keys.front());
  return values.empty() ? 0.0 : values[0];
}

Status set_file_size(const cv::FileStorage& file, const std::string& path, SourceCamera& camera) {
  STGS_ASSIGN(const double width, number(file, kWidth, path));
  STGS_ASSIGN(const double height, number(file, kHeight, path));
  return width == 0 && height == 0 ? Status() : set_size(width, height, path, camera);
}

Result<Calibration> read_file(const cv::FileStorage& file, const std::string& path,
                              const std::string& name) {
  Calibration calibration;
  if (!has_any(file, kMatrix) || !has_any(file, kRotation) || !has_any(file, kTranslation)) {
    return calibration;
  }
  SourceCamera& camera = calibration.cameras.emplace_back();
  camera.name = name;
  STGS_ASSIGN(const std::vector<double> matrix, storage_numbers(file, kMatrix, path));
  STGS_TRY(set_intrinsics(matrix, 0, path, camera));
  STGS_ASSIGN(std::vector<double> lens, storage_numbers(file, kDistortion, path));
  STGS_ASSIGN(const double fisheye, number(file, kFisheye, path));
  STGS_TRY(set_distortion(std::move(lens), fisheye != 0, path, camera));
  STGS_ASSIGN(const std::vector<double> rotation, storage_numbers(file, kRotation, path));
  STGS_ASSIGN(const std::vector<double> translation, storage_numbers(file, kTranslation, path));
  STGS_TRY(set_opencv_pose(rotation, translation, path, camera));
  STGS_TRY(set_file_size(file, path, camera));
  return calibration;
}

}  // namespace

Result<Calibration> read_opencv_camera(const CaptureFolder& files, const std::string& path,
                                       const std::string& name) {
  STGS_ASSIGN(const cv::FileStorage file, open_storage(files, path));
  try {
    return read_file(file, path, name);
  } catch (const cv::Exception& error) {  // a list in place of keys, for example
    return invalid_file("{}: not a calibration of OpenCV: {}", path, error.err);
  }
}

}  // namespace stgs::encoder
