// SPDX-License-Identifier: Apache-2.0
// Qualisys Track Manager: XML with <calibration><cameras>, one <camera serial="..."> per camera,
// and in each:
//   <fov_video left top right bottom>                    the recorded part of the sensor, pixels
//   <transform x y z r11 ... r33>                        position, mm; rotation
//   <intrinsic focalLengthU centerPointU ... skew radialDistortion1 ... tangentalDistortion1 ...>
// Focal lengths and centres are in units of 1/64 pixel, from the centre of the sensor's first pixel
// (sensorMaxU is 64 times the index of the last pixel). The distortion coefficients are OpenCV's,
// in normalised coordinates. The rows of the rotation are the camera axes right, up and backward.
#include <charconv>
#include <cmath>
#include <pugixml.hpp>

#include "calibration.h"
#include "capture_files.h"

namespace stgs::encoder {
namespace {

constexpr double kUnitsPerPixel = 64;
constexpr double kMetresPerUnit = 0.001;

// Reads finite numbers from the attributes of an element of a camera.
Result<std::vector<double>> numbers(const pugi::xml_node& camera, const char* element,
                                    std::initializer_list<const char*> keys,
                                    const std::string& where) {
  std::vector<double> values;
  const pugi::xml_node node = camera.child(element);
  if (!node) return invalid_file("{}: <{}> is missing", where, element);
  for (const char* key : keys) {
    const pugi::xml_attribute attribute = node.attribute(key);
    if (!attribute) return invalid_file("{}: <{}> has no attribute {}", where, element, key);
    const std::string_view text = attribute.value();
    double value = 0;
    const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || stop != text.data() + text.size() || !std::isfinite(value)) {
      return invalid_file("{}: <{}> {} is not a number: '{}'", where, element, key, text);
    }
    values.push_back(value);
  }
  return values;
}

Status set_qualisys_intrinsics(const pugi::xml_node& node, const std::string& where,
                               SourceCamera& camera) {
  STGS_ASSIGN(const std::vector<double> fov,
              numbers(node, "fov_video", {"left", "top", "right", "bottom"}, where));
  STGS_TRY(set_size(fov[2] - fov[0] + 1, fov[3] - fov[1] + 1, where + ": <fov_video>", camera));
  STGS_ASSIGN(
      std::vector<double> k,
      numbers(node, "intrinsic",
              {"focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew"}, where));
  for (double& v : k) v /= kUnitsPerPixel;
  STGS_TRY(set_intrinsics({k[0], k[4], k[2] - fov[0], 0, k[1], k[3] - fov[1], 0, 0, 1}, 0, where,
                          camera));
  STGS_ASSIGN(std::vector<double> lens,
              numbers(node, "intrinsic",
                      {"radialDistortion1", "radialDistortion2", "tangentalDistortion1",
                       "tangentalDistortion2", "radialDistortion3"},
                      where));
  return set_distortion(std::move(lens), false, where, camera);
}

Status set_qualisys_pose(const pugi::xml_node& node, const std::string& where,
                         SourceCamera& camera) {
  STGS_ASSIGN(const std::vector<double> t, numbers(node, "transform",
                                                   {"r11", "r12", "r13", "r21", "r22", "r23", "r31",
                                                    "r32", "r33", "x", "y", "z"},
                                                   where));
  for (int row = 0; row < 3; ++row) {
    const double sign = row == 0 ? 1 : -1;  // up and backward become down and forward
    camera.translation[row] = 0;
    for (int column = 0; column < 3; ++column) {
      const double r = sign * t[3 * row + column];
      camera.rotation[3 * row + column] = r;
      camera.translation[row] -= r * t[9 + column] * kMetresPerUnit;
    }
  }
  return {};
}

}  // namespace

Result<Calibration> read_qualisys(const CaptureFolder& files, const std::string& path,
                                  const LogSink& log) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, read_table(files, path));
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(bytes.data(), bytes.size());
  if (!parsed) {
    return invalid_file("{}: not valid XML: {} [byte {}]", path, parsed.description(),
                        parsed.offset);
  }
  const pugi::xml_node cameras = document.child("calibration").child("cameras");
  Calibration calibration;
  calibration.metric = true;
  for (const pugi::xml_node& node : cameras.children("camera")) {
    SourceCamera camera;
    camera.name = node.attribute("serial").value();
    if (node.attribute("active").as_string("1") == std::string_view("0")) continue;
    const std::string where = fmt::format("{}: camera '{}'", path, camera.name);
    if (!node.child("fov_video")) {
      log(2, fmt::format("{} ignored (records no video)", where));
      continue;
    }
    STGS_TRY(set_qualisys_intrinsics(node, where, camera));
    STGS_TRY(set_qualisys_pose(node, where, camera));
    const int rotation = node.attribute("viewrotation").as_int();
    if (rotation != 0) {
      log(1, fmt::format("{}: view rotation {} is not applied; the frames must be in sensor "
                         "orientation",
                         where, rotation));
    }
    calibration.cameras.push_back(std::move(camera));
  }
  if (!calibration.cameras.empty()) return calibration;
  return invalid_file(
      "{}: not a Qualisys calibration of video cameras (expected <camera> with <fov_video>, "
      "<intrinsic> and <transform>)",
      path);
}

}  // namespace stgs::encoder
