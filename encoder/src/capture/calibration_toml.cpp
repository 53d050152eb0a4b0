// SPDX-License-Identifier: Apache-2.0
// Pose2Sim and Anipose (aniposelib): TOML with one table per camera. Tables without a matrix are
// ignored.
//   name          optional, default: the name of the table
//   size          optional: width, height
//   matrix        3x3, pixels
//   distortions   OpenCV order; fisheye: k1 k2 k3 k4
//   fisheye       optional, true: distortions are of OpenCV's fisheye model
//   rotation      rotation vector, world to camera
//   translation   world to camera
// The unit of the translation is not stated.
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>

#include "calibration.h"
#include "capture_files.h"
#include "opencv_storage.h"

namespace stgs::encoder {
namespace {

// Greatest number of parts of a dotted key. Each part is a table, and toml++ recurses over them. It
// limits the nesting of values itself.
constexpr int kMaxKeyParts = 16;
// Greatest size of a file: 500 bytes for each of the cameras that a capture may have. toml++ takes
// time quadratic in the number of dotted keys.
constexpr std::uint64_t kMaxTomlBytes = 512 << 10;

// Counts the dots between separators, as of a key. A key ends on its line; if the line has quotes,
// they may contain separators, so all its dots count.
Status check_keys(std::string_view text, const std::string& path) {
  while (!text.empty()) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
    const std::size_t first = line.find_first_not_of(" \t");
    if (first == std::string_view::npos || line[first] == '#') continue;  // empty or a comment
    const bool has_quotes = line.find_first_of("\"'") != std::string_view::npos;
    int dots = 0;
    for (const char c : line) {
      const bool separates =
          !has_quotes && std::string_view(",=[]{}#").find(c) != std::string_view::npos;
      dots = separates ? 0 : dots + (c == '.');
      if (dots >= kMaxKeyParts) {
        return invalid_file("{}: a key has more than {} parts", path, kMaxKeyParts);
      }
    }
  }
  return {};
}

// Appends the finite numbers of a nested array, row by row. Returns false for other content.
bool flatten(const toml::node& node, std::vector<double>& out) {
  if (const toml::array* array = node.as_array()) {
    for (const toml::node& child : *array) {
      if (!flatten(child, out)) return false;
    }
    return true;
  }
  if (!node.is_number()) return false;
  out.push_back(node.value<double>().value_or(NAN));
  return std::isfinite(out.back());
}

Result<std::vector<double>> numbers(const toml::table& table, std::string_view key,
                                    const std::string& where) {
  const toml::node* node = table.get(key);
  if (node == nullptr) return invalid_file("{}: '{}' is missing", where, key);
  std::vector<double> out;
  if (node->is_array() && flatten(*node, out)) return out;
  return invalid_file("{}: '{}' is not a list of finite numbers", where, key);
}

Result<SourceCamera> read_camera(const toml::table& table, std::string_view name,
                                 const std::string& path) {
  SourceCamera camera;
  camera.name = table["name"].value_or(std::string(name));
  const std::string where = fmt::format("{}: camera '{}'", path, camera.name);
  STGS_ASSIGN(const std::vector<double> matrix, numbers(table, "matrix", where));
  STGS_TRY(set_intrinsics(matrix, 0, where, camera));
  STGS_ASSIGN(std::vector<double> distortions, numbers(table, "distortions", where));
  const bool fisheye = table["fisheye"].value_or(false);
  STGS_TRY(set_distortion(std::move(distortions), fisheye, where, camera));
  STGS_ASSIGN(const std::vector<double> rotation, numbers(table, "rotation", where));
  STGS_ASSIGN(const std::vector<double> translation, numbers(table, "translation", where));
  STGS_TRY(set_opencv_pose(rotation, translation, where, camera));
  if (!table.contains("size")) return camera;
  STGS_ASSIGN(const std::vector<double> size, numbers(table, "size", where));
  if (size.size() != 2) {
    return invalid_file("{}: invalid size (expected width and height)", where);
  }
  STGS_TRY(set_size(size[0], size[1], where, camera));
  return camera;
}

}  // namespace

Result<Calibration> read_toml_calibration(const CaptureFolder& files, const std::string& path) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, files.read(path, kMaxTomlBytes));
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  STGS_TRY(check_keys(text, path));
  toml::table root;
  try {
    root = toml::parse(text);
  } catch (const toml::parse_error& error) {
    return invalid_file("{}: not valid TOML at line {}: {}", path, error.source().begin.line,
                        error.description());
  }
  Calibration calibration;
  for (const auto& [name, node] : root) {
    const toml::table* table = node.as_table();
    if (table == nullptr || !table->contains("matrix")) continue;
    STGS_ASSIGN(SourceCamera camera, read_camera(*table, name.str(), path));
    calibration.cameras.push_back(std::move(camera));
  }
  if (!calibration.cameras.empty()) return calibration;
  return invalid_file(
      "{}: no cameras (expected tables with matrix, distortions, rotation and translation)", path);
}

}  // namespace stgs::encoder
