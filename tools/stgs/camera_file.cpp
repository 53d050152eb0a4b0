// SPDX-License-Identifier: Apache-2.0
#include "camera_file.h"

#include <cmath>
#include <fstream>

namespace stgs::tools {
namespace {

constexpr double kOrthonormal = 1e-3;  // largest error of R R' - 1 and det R - 1

bool is_rotation(const double* r) {
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      double dot = 0;
      for (int k = 0; k < 3; ++k) dot += r[3 * i + k] * r[3 * j + k];
      if (!(std::abs(dot - (i == j ? 1 : 0)) <= kOrthonormal)) return false;
    }
  }
  const double determinant = r[0] * (r[4] * r[8] - r[5] * r[7]) -
                             r[1] * (r[3] * r[8] - r[5] * r[6]) +
                             r[2] * (r[3] * r[7] - r[4] * r[6]);
  return determinant > 0;
}

Status check(const encoder::Camera& camera, const std::string& path) {
  const auto side = [](int v) { return v >= 1 && v <= kMaxSide; };
  if (!side(camera.width) || !side(camera.height)) {
    return invalid_file("{}: width and height must be 1 to {} pixels", path, kMaxSide);
  }
  const bool focal = camera.fx > 0 && camera.fy > 0 && std::isfinite(camera.fx) &&
                     std::isfinite(camera.fy) && std::isfinite(camera.cx) &&
                     std::isfinite(camera.cy);
  if (!focal) return invalid_file("{}: fx and fy must be positive numbers of pixels", path);
  if (!is_rotation(camera.rotation)) {
    return invalid_file("{}: rotation is not a rotation matrix (world to camera, row by row)",
                        path);
  }
  return {};
}

encoder::Camera camera_from(const Json& json) {
  encoder::Camera camera;
  camera.name = json.value("name", std::string("camera"));
  camera.width = json.at("width").get<int>();
  camera.height = json.at("height").get<int>();
  camera.fx = json.at("fx").get<double>();
  camera.fy = json.at("fy").get<double>();
  camera.cx = json.at("cx").get<double>();
  camera.cy = json.at("cy").get<double>();
  const auto rotation = json.at("rotation").get<std::vector<double>>();
  const auto translation = json.at("translation").get<std::vector<double>>();
  if (rotation.size() != 9 || translation.size() != 3) {
    throw std::runtime_error("rotation needs 9 numbers, translation 3");
  }
  std::copy(rotation.begin(), rotation.end(), camera.rotation);
  std::copy(translation.begin(), translation.end(), camera.translation);
  return camera;
}

}  // namespace

Result<encoder::Camera> read_camera(const std::string& path) {
  std::ifstream file(path);
  if (!file) return io_error("{}: cannot open this camera file", path);
  try {
    const Json json = Json::parse(file);
    encoder::Camera camera =
        camera_from(json.contains("start_camera") ? json.at("start_camera") : json);
    STGS_TRY(check(camera, path));
    return camera;
  } catch (const std::exception& error) {
    return invalid_file("{}: not a camera: {}", path, error.what());
  }
}

Result<encoder::Camera> camera_of(const StartCamera& start, const std::string& file) {
  const std::string name = file + ": start camera";
  // Before they become signed.
  if (start.width > kMaxSide || start.height > kMaxSide) {
    return invalid_file("{}: {}x{} pixels; a side has at most {}", name, start.width, start.height,
                        kMaxSide);
  }
  encoder::Camera camera;
  camera.name = "start";
  camera.width = static_cast<int>(start.width);
  camera.height = static_cast<int>(start.height);
  camera.fx = start.fx;
  camera.fy = start.fy;
  camera.cx = start.cx;
  camera.cy = start.cy;
  std::copy(start.rotation, start.rotation + 9, camera.rotation);
  std::copy(start.translation, start.translation + 3, camera.translation);
  STGS_TRY(check(camera, name));
  return camera;
}

Json camera_json(const StartCamera& start) {
  return {{"width", start.width},
          {"height", start.height},
          {"fx", start.fx},
          {"fy", start.fy},
          {"cx", start.cx},
          {"cy", start.cy},
          {"rotation", std::vector<float>(start.rotation, start.rotation + 9)},
          {"translation", std::vector<float>(start.translation, start.translation + 3)}};
}

encoder::Camera resized(encoder::Camera camera, Size size) {
  const double x = static_cast<double>(size.width) / camera.width;
  const double y = static_cast<double>(size.height) / camera.height;
  camera.fx *= x;
  camera.cx *= x;
  camera.fy *= y;
  camera.cy *= y;
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

Result<std::vector<encoder::Camera>> choose_cameras(const encoder::PreparedCapture& capture,
                                                    const std::string& which) {
  std::vector<encoder::Camera> chosen;
  if (which == "all" || which == "test" || which == "train") {
    for (const encoder::Camera& camera : capture.cameras) {
      if (which == "all" || camera.test == (which == "test")) chosen.push_back(camera);
    }
    if (chosen.empty()) {
      return usage_error("{}: the capture has no {} cameras; name one, or say all", capture.folder,
                         which);
    }
    return chosen;
  }
  std::vector<std::string> names;
  for (const encoder::Camera& camera : capture.cameras) names.push_back(camera.name);
  for (const std::string& name : split_list(which)) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      return usage_error("{}: has no camera '{}'; its cameras are {}", capture.folder, name,
                         fmt::format("{}", fmt::join(names, ", ")));
    }
    chosen.push_back(capture.cameras[static_cast<std::size_t>(found - names.begin())]);
  }
  if (chosen.empty()) return usage_error("no camera is named; say test, train, all or names");
  return chosen;
}

}  // namespace stgs::tools
