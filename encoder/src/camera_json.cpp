// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/camera_json.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <span>

#include "json_error.h"
#include "single_precision.h"
#include "stgs/format/camera.h"

namespace stgs::encoder {
namespace {

// Throws std::runtime_error with the key and the expected type.
template <typename T>
T read_value(const nlohmann::json& json, const char* key, const char* expected) {
  const auto entry = json.find(key);
  if (entry == json.end()) {
    throw std::runtime_error(fmt::format("\"{}\" is missing (expected {})", key, expected));
  }
  try {
    return entry->get<T>();
  } catch (const nlohmann::json::exception&) {
    throw std::runtime_error(fmt::format("\"{}\" has the wrong type (expected {}, got {})", key,
                                         expected, entry->type_name()));
  }
}

double read_number(const nlohmann::json& json, const char* key) {
  return read_value<double>(json, key, "a number");
}

void read_numbers(const nlohmann::json& json, const char* key, std::span<double> out) {
  const auto values = read_value<std::vector<double>>(
      json, key, out.size() == 9 ? "a list of 9 numbers" : "a list of 3 numbers");
  if (values.size() != out.size()) {
    throw std::runtime_error(
        fmt::format("\"{}\" has {} numbers (expected {})", key, values.size(), out.size()));
  }
  std::copy(values.begin(), values.end(), out.begin());
}

// Checks the range before the conversion, which is undefined for values that no int represents.
int read_side(const nlohmann::json& json, const char* key) {
  const double value = read_number(json, key);
  if (value >= 0 && value <= kMaxImageSide && value == std::floor(value)) {
    return static_cast<int>(value);
  }
  throw std::runtime_error(fmt::format("\"{}\" is {} (expected an integer from 1 to {} pixels)",
                                       key, value, kMaxImageSide));
}

}  // namespace

Result<Camera> camera_from_json(const nlohmann::json& json, const std::string& where) {
  if (!json.is_object()) {
    return invalid_file("{}: not a camera (expected a JSON object, got {})", where,
                        json.type_name());
  }
  Camera camera;
  camera.name = "camera";
  try {
    if (json.contains("name")) camera.name = read_value<std::string>(json, "name", "a string");
    camera.width = read_side(json, "width");
    camera.height = read_side(json, "height");
    camera.fx = read_number(json, "fx");
    camera.fy = read_number(json, "fy");
    camera.cx = read_number(json, "cx");
    camera.cy = read_number(json, "cy");
    if (json.contains("test")) camera.test = read_value<bool>(json, "test", "true or false");
    if (json.contains("time_offset")) camera.time_offset = read_number(json, "time_offset");
    if (json.contains("fps")) camera.fps = read_number(json, "fps");
    read_numbers(json, "rotation", camera.rotation);
    read_numbers(json, "translation", camera.translation);
  } catch (const std::exception& error) {
    if (!json.contains("name")) {
      return invalid_file("{}: not a camera: {}", where, json_error(error));
    }
    return invalid_file("{}: camera '{}': {}", where, camera.name, json_error(error));
  }
  STGS_TRY(check_camera(camera, where));
  return camera;
}

nlohmann::ordered_json camera_to_json(const Camera& camera) {
  nlohmann::ordered_json json = {
      {"name", camera.name},
      {"width", camera.width},
      {"height", camera.height},
      {"fx", camera.fx},
      {"fy", camera.fy},
      {"cx", camera.cx},
      {"cy", camera.cy},
      {"rotation", std::vector<double>(camera.rotation, camera.rotation + 9)},
      {"translation", std::vector<double>(camera.translation, camera.translation + 3)},
      {"test", camera.test}};
  if (camera.time_offset != 0) json["time_offset"] = camera.time_offset;
  if (camera.fps != 0) json["fps"] = camera.fps;
  return json;
}

Result<Camera> parse_camera(std::string_view text, const std::string& where) {
  STGS_ASSIGN(const nlohmann::json json, parse_json_text(text, where + ": cannot read camera"));
  try {
    const auto start = json.is_object() ? json.find("start_camera") : json.end();
    if (start == json.end()) return camera_from_json(json, where);
    if (!start->is_null()) return camera_from_json(*start, where);
  } catch (const std::exception& error) {
    return invalid_file("{}: cannot read camera: {}", where, json_error(error));
  }
  return invalid_file("{}: start_camera is null: the scene has none; use another camera file",
                      where);
}

Status check_camera(const Camera& camera, const std::string& where) {
  const auto side = [](int v) { return v >= 1 && v <= kMaxImageSide; };
  if (!side(camera.width) || !side(camera.height)) {
    return invalid_file("{}: camera '{}': width and height must be 1 to {} pixels (got {}x{})",
                        where, camera.name, kMaxImageSide, camera.width, camera.height);
  }
  if (!positive_in_float(camera.fx) || !positive_in_float(camera.fy) ||
      !finite_in_float(camera.cx) || !finite_in_float(camera.cy)) {
    return invalid_file(
        "{}: camera '{}': fx and fy must be positive and the centre (cx, cy) finite, in pixels "
        "(got fx {}, fy {}, cx {}, cy {})",
        where, camera.name, camera.fx, camera.fy, camera.cx, camera.cy);
  }
  if (!is_rotation(camera.rotation)) {
    return invalid_file(
        "{}: camera '{}': rotation is not a rotation matrix (expected 9 numbers, world to camera, "
        "row-major)",
        where, camera.name);
  }
  if (!std::all_of(camera.translation, camera.translation + 3, finite_in_float)) {
    return invalid_file("{}: camera '{}': translation is not finite", where, camera.name);
  }
  if (!(std::abs(camera.time_offset) <= kMaxTimeOffset)) {
    return invalid_file("{}: camera '{}': time_offset is {} (expected at most {} seconds)", where,
                        camera.name, camera.time_offset, kMaxTimeOffset);
  }
  if (camera.fps != 0 && !(camera.fps >= kMinFps && camera.fps <= kMaxFps)) {
    return invalid_file("{}: camera '{}': fps is {} (expected {} to {})", where, camera.name,
                        camera.fps, kMinFps, kMaxFps);
  }
  return {};
}

}  // namespace stgs::encoder
