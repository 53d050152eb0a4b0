// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/camera_json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>

#include "stgs/encoder/json_error.h"
#include "stgs/format/camera.h"

namespace stgs::encoder {
namespace {

using Json = nlohmann::ordered_json;

// Training and the file format calculate in floats.
bool finite(double value) {
  return std::isfinite(static_cast<float>(value));
}

bool positive(double value) {
  return finite(value) && static_cast<float>(value) > 0;
}

void read_numbers(const Json& json, const char* name, std::span<double> out) {
  const auto values = json.at(name).get<std::vector<double>>();
  if (values.size() != out.size()) {
    throw std::runtime_error(fmt::format("{} needs {} numbers", name, out.size()));
  }
  std::copy(values.begin(), values.end(), out.begin());
}

// A number of the text may be any; what no int holds must not become one.
int read_side(const Json& json, const char* name) {
  const auto value = json.at(name).get<double>();
  if (value >= 0 && value <= kMaxImageSide) return static_cast<int>(value);
  throw std::runtime_error(fmt::format("{} is {}, not 1 to {} pixels", name, value, kMaxImageSide));
}

}  // namespace

Result<Camera> camera_from_json(const Json& json, const std::string& where) {
  Camera camera;
  camera.name = "camera";
  try {
    camera.name = json.value("name", camera.name);
    camera.width = read_side(json, "width");
    camera.height = read_side(json, "height");
    camera.fx = json.at("fx").get<double>();
    camera.fy = json.at("fy").get<double>();
    camera.cx = json.at("cx").get<double>();
    camera.cy = json.at("cy").get<double>();
    camera.test = json.value("test", false);
    read_numbers(json, "rotation", camera.rotation);
    read_numbers(json, "translation", camera.translation);
  } catch (const std::exception& error) {
    return invalid_file("{}: not a camera: '{}': {}", where, camera.name, json_error(error));
  }
  STGS_TRY(check_camera(camera, where));
  return camera;
}

Json camera_to_json(const Camera& camera) {
  return {{"name", camera.name},
          {"width", camera.width},
          {"height", camera.height},
          {"fx", camera.fx},
          {"fy", camera.fy},
          {"cx", camera.cx},
          {"cy", camera.cy},
          {"rotation", std::vector<double>(camera.rotation, camera.rotation + 9)},
          {"translation", std::vector<double>(camera.translation, camera.translation + 3)},
          {"test", camera.test}};
}

Status check_camera(const Camera& camera, const std::string& where) {
  const auto side = [](int v) { return v >= 1 && v <= kMaxImageSide; };
  if (!side(camera.width) || !side(camera.height)) {
    return invalid_file("{}: camera '{}' is of {}x{} pixels; width and height must be 1 to {}",
                        where, camera.name, camera.width, camera.height, kMaxImageSide);
  }
  if (!positive(camera.fx) || !positive(camera.fy) || !finite(camera.cx) || !finite(camera.cy)) {
    return invalid_file(
        "{}: camera '{}': fx and fy must be positive, the centre cx and cy finite, in pixels",
        where, camera.name);
  }
  if (!is_rotation(camera.rotation) ||
      !std::all_of(camera.translation, camera.translation + 3, finite)) {
    return invalid_file(
        "{}: camera '{}': rotation is not a rotation matrix (world to camera, row by row), or "
        "translation not finite",
        where, camera.name);
  }
  return {};
}

}  // namespace stgs::encoder
