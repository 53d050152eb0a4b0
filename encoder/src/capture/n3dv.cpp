// SPDX-License-Identifier: Apache-2.0
// Layout "n3dv" (Neural 3D Video): camNN.mp4, or image folders camNN/, next to poses_bounds.npy.
// poses_bounds.npy is LLFF's table with one row of 17 numbers per camera, in the order of the
// names:
//   - a 3x5 matrix: camera-to-world with the axes down, right, backward, and a last column of
//     height, width, focal length;
//   - near and far depth, which are not used.
// The first camera by name is held out, as in the paper of the data set.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "capture_files.h"
#include "plural.h"
#include "stgs/format/camera.h"

namespace stgs::encoder {
namespace {

constexpr std::size_t kRow = 17;

// Returns the value of `key` in a .npy header: the text up to the next comma outside parentheses.
std::string npy_field(const std::string& header, const std::string& key) {
  const std::size_t at = header.find("'" + key + "':");
  if (at == std::string::npos) return "";
  std::string value;
  int depth = 0;
  for (std::size_t i = at + key.size() + 3; i < header.size(); ++i) {
    if (header[i] == '(') ++depth;
    if (header[i] == ')') --depth;
    if (depth == 0 && (header[i] == ',' || header[i] == '}')) break;
    if (header[i] != ' ') value += header[i];
  }
  return value;
}

template <typename T>
std::vector<double> numbers_from(const std::uint8_t* bytes, std::size_t count) {
  std::vector<double> numbers(count);
  for (std::size_t i = 0; i < count; ++i) {
    T value;
    std::memcpy(&value, bytes + i * sizeof(T), sizeof(T));
    numbers[i] = static_cast<double>(value);
  }
  return numbers;
}

// Reads a little-endian N x 17 float array, row by row.
Result<std::vector<double>> read_poses(const CaptureFolder& files, const std::string& path) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, read_table(files, path));
  if (bytes.size() < 10 || std::memcmp(bytes.data(), "\x93NUMPY", 6) != 0) {
    return invalid_file("{}: not a NumPy .npy file", path);
  }
  const bool long_header = bytes[6] >= 2;
  std::size_t start = long_header ? 12 : 10;
  if (bytes.size() < start) return invalid_file("{}: truncated .npy header", path);
  std::size_t length = bytes[8] | bytes[9] << 8;
  if (long_header) length |= std::size_t{bytes[10]} << 16 | std::size_t{bytes[11]} << 24;
  if (length > bytes.size() - start) {
    return invalid_file("{}: truncated: the header states {} bytes (file has {})", path, length,
                        bytes.size() - start);
  }
  const std::string header(bytes.begin() + start, bytes.begin() + start + length);
  start += length;
  const std::string type = npy_field(header, "descr");
  const std::size_t item = type == "'<f8'" ? 8 : type == "'<f4'" ? 4 : 0;
  unsigned long long rows = 0, columns = 0;
  const std::string shape = npy_field(header, "shape");
  const bool table = std::sscanf(shape.c_str(), "(%llu,%llu)", &rows, &columns) == 2;
  if (item == 0 || !table || columns != kRow || npy_field(header, "fortran_order") != "False") {
    return invalid_file("{}: expected a row-major N x 17 float array, got {}", path,
                        header.substr(0, header.find('\n')));
  }
  if (rows > (bytes.size() - start) / (item * kRow)) {
    return invalid_file("{}: truncated (expected {} cameras, got {})", path, rows,
                        (bytes.size() - start) / (item * kRow));
  }
  const std::size_t count = rows * kRow;
  return item == 8 ? numbers_from<double>(bytes.data() + start, count)
                   : numbers_from<float>(bytes.data() + start, count);
}

Status set_camera(const double* row, const std::string& where, SourceCamera& camera) {
  const bool finite = std::all_of(row, row + kRow, [](double v) { return std::isfinite(v); });
  const double height = row[4], width = row[9], focal = row[14];
  if (!finite || !(height >= 1 && height <= kMaxImageSide && width >= 1 && width <= kMaxImageSide &&
                   focal > 0)) {
    return invalid_file(
        "{}: invalid image size or focal length (got height {}, width {}, focal length {})", where,
        height, width, focal);
  }
  camera.width = static_cast<int>(std::lround(width));
  camera.height = static_cast<int>(std::lround(height));
  camera.fx = camera.fy = focal;
  camera.cx = 0.5 * width;
  camera.cy = 0.5 * height;
  std::vector<double> c2w(12);
  for (int i = 0; i < 3; ++i) {
    const double down = row[5 * i], right = row[5 * i + 1], backward = row[5 * i + 2];
    c2w[4 * i] = right;
    c2w[4 * i + 1] = down;
    c2w[4 * i + 2] = -backward;
    c2w[4 * i + 3] = row[5 * i + 3];
  }
  return set_pose_from_camera_to_world(c2w, where, camera);
}

Result<std::vector<std::string>> camera_names(const CaptureFolder& files) {
  std::vector<std::string> names;
  STGS_ASSIGN(const std::vector<std::string> videos, list_videos(files, files.path()));
  for (const std::string& path : videos) names.push_back(stem_of(path));
  if (!names.empty()) return names;
  STGS_ASSIGN(const std::vector<std::string> folders, list_folders(files, files.path()));
  for (const std::string& path : folders) {
    const std::string name = std::filesystem::path(path).filename().string();
    if (name.rfind("cam", 0) == 0) names.push_back(name);
  }
  return names;
}

}  // namespace

Result<SourceCapture> load_n3dv(const CaptureFolder& files) {
  const std::string& folder = files.path();
  const std::string poses_path = folder + "/poses_bounds.npy";
  STGS_ASSIGN(const std::vector<double> rows, read_poses(files, poses_path));
  STGS_TRY(check_camera_limit(rows.size() / kRow, poses_path));
  STGS_ASSIGN(const std::vector<std::string> names, camera_names(files));
  if (names.size() != rows.size() / kRow) {
    return invalid_file(
        "{}: {} but {} in the folder ({}); the file must have one row per video, in the order of "
        "the names",
        poses_path, plural(rows.size() / kRow, "camera"), plural(names.size(), "video"),
        names.empty() ? "none" : names.front() + " .. " + names.back());
  }
  SourceCapture capture;
  capture.split_known = true;
  for (std::size_t i = 0; i < names.size(); ++i) {
    SourceCamera camera;
    camera.name = names[i];
    STGS_TRY(set_camera(rows.data() + i * kRow,
                        fmt::format("{}: row {} (camera '{}')", poses_path, i, names[i]), camera));
    STGS_ASSIGN(const bool found, find_frames(files, folder, names[i], camera));
    if (!found) {
      return io_error("{}/{}: no frames for camera '{}'", folder, names[i], names[i]);
    }
    camera.test = i == 0;
    capture.cameras.push_back(std::move(camera));
  }
  return capture;
}

}  // namespace stgs::encoder
