// SPDX-License-Identifier: Apache-2.0
#include "colmap_model.h"

#include <algorithm>
#include <cstring>
#include <sstream>

#include "capture_files.h"
#include "natural_order.h"
#include "single_precision.h"

namespace stgs::encoder {
namespace {

struct ModelKind {
  const char* name;
  std::size_t params;
};
// Indexed by COLMAP's model number.
constexpr std::array<ModelKind, 11> kModels = {{{"SIMPLE_PINHOLE", 3},
                                                {"PINHOLE", 4},
                                                {"SIMPLE_RADIAL", 4},
                                                {"RADIAL", 5},
                                                {"OPENCV", 8},
                                                {"OPENCV_FISHEYE", 8},
                                                {"FULL_OPENCV", 12},
                                                {"FOV", 5},
                                                {"SIMPLE_RADIAL_FISHEYE", 4},
                                                {"RADIAL_FISHEYE", 5},
                                                {"THIN_PRISM_FISHEYE", 12}}};

const ModelKind* kind_of(const std::string& name) {
  const auto it = std::find_if(kModels.begin(), kModels.end(),
                               [&](const ModelKind& kind) { return name == kind.name; });
  return it == kModels.end() ? nullptr : &*it;
}

// Reads little-endian values from memory. Past the end it returns zeros and sets past().
class Cursor {
 public:
  Cursor(const std::vector<std::uint8_t>& bytes) : bytes_(bytes) {}

  template <typename T>
  T read() {
    T value{};
    if (!has(sizeof(T))) return value;
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  std::string read_string() {
    const auto begin = bytes_.begin() + static_cast<std::ptrdiff_t>(at_);
    const auto end = std::find(begin, bytes_.end(), std::uint8_t{0});
    if (end == bytes_.end()) past_ = true;
    std::string text(begin, end);
    at_ = std::min(bytes_.size(), at_ + text.size() + 1);
    return text;
  }
  // Returns true if `count` items of at least `size` bytes can follow.
  bool fits(std::uint64_t count, std::uint64_t size) {
    if (count > (bytes_.size() - at_) / size) past_ = true;
    return !past_;
  }
  void skip(std::uint64_t count, std::uint64_t size) {
    if (fits(count, size)) at_ += count * size;
  }
  bool past() const { return past_; }
  std::size_t at() const { return at_; }

 private:
  bool has(std::size_t size) {
    if (size > bytes_.size() - at_) past_ = true;
    return !past_;
  }
  const std::vector<std::uint8_t>& bytes_;
  std::size_t at_ = 0;
  bool past_ = false;
};

Status truncated(const std::string& path, const char* what, std::uint64_t index,
                 std::uint64_t count, const Cursor& cursor) {
  return invalid_file("{}: truncated, or not a COLMAP model ({} {} of {}) [byte {}]", path, what,
                      index, count, cursor.at());
}

Status read_cameras_binary(const CaptureFolder& files, const std::string& path,
                           ColmapModel& model) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, files.read(path, kCaptureLimits.file_bytes));
  Cursor cursor(bytes);
  const auto count = cursor.read<std::uint64_t>();
  if (!cursor.fits(count, 24)) return truncated(path, "camera", 0, count, cursor);
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto id = cursor.read<std::uint32_t>();
    const auto kind = cursor.read<std::uint32_t>();
    if (!cursor.past() && kind >= kModels.size()) {
      return unsupported("{}: camera {} has unknown model number {} (expected 0 to {})", path, id,
                         kind, kModels.size() - 1);
    }
    ColmapCamera camera;
    camera.width = cursor.read<std::uint64_t>();
    camera.height = cursor.read<std::uint64_t>();
    if (cursor.past()) return truncated(path, "camera", i, count, cursor);
    camera.model = kModels[kind].name;
    for (std::size_t p = 0; p < kModels[kind].params; ++p) {
      camera.params.push_back(cursor.read<double>());
    }
    if (cursor.past()) return truncated(path, "camera", i, count, cursor);
    model.cameras[id] = std::move(camera);
  }
  return {};
}

Status read_images_binary(const CaptureFolder& files, const std::string& path, ColmapModel& model) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, files.read(path, kCaptureLimits.file_bytes));
  Cursor cursor(bytes);
  const auto count = cursor.read<std::uint64_t>();
  if (!cursor.fits(count, 73)) return truncated(path, "image", 0, count, cursor);
  for (std::uint64_t i = 0; i < count; ++i) {
    ColmapImage image;
    cursor.read<std::uint32_t>();  // id
    for (double& v : image.rotation) v = cursor.read<double>();
    for (double& v : image.translation) v = cursor.read<double>();
    image.camera = cursor.read<std::uint32_t>();
    image.name = cursor.read_string();
    cursor.skip(cursor.read<std::uint64_t>(), 24);  // features
    if (cursor.past()) return truncated(path, "image", i, count, cursor);
    model.images.push_back(std::move(image));
  }
  return {};
}

Status read_points_binary(const CaptureFolder& files, const std::string& path, ColmapModel& model) {
  STGS_ASSIGN(const std::vector<std::uint8_t> bytes, files.read(path, kCaptureLimits.file_bytes));
  Cursor cursor(bytes);
  const auto count = cursor.read<std::uint64_t>();
  if (!cursor.fits(count, 51)) return truncated(path, "point", 0, count, cursor);
  for (std::uint64_t i = 0; i < count; ++i) {
    InitialPoint point{};
    point.frame = -1;
    cursor.read<std::uint64_t>();  // id
    for (float& v : point.position) {
      const auto value = cursor.read<double>();
      if (!finite_in_float(value)) {
        return invalid_file("{}: point {} has a position that is not finite", path, i);
      }
      v = static_cast<float>(value);
    }
    for (std::uint8_t& v : point.colour) v = cursor.read<std::uint8_t>();
    cursor.read<double>();                         // reprojection error
    cursor.skip(cursor.read<std::uint64_t>(), 8);  // track
    if (cursor.past()) return truncated(path, "point", i, count, cursor);
    model.points.push_back(point);
  }
  return {};
}

// The lines of a text file that are not comments, one after the other. Empty lines remain, because
// the feature line of an image may be empty.
class TextLines {
 public:
  static Result<TextLines> open(const CaptureFolder& files, const std::string& path) {
    TextLines lines;
    STGS_ASSIGN(lines.bytes_, read_table(files, path));
    return lines;
  }
  // Reads the next line. Returns false at the end.
  bool next(std::string& line) {
    do {
      if (at_ == bytes_.size()) return false;
      const auto begin = bytes_.begin() + static_cast<std::ptrdiff_t>(at_);
      const auto end = std::find(begin, bytes_.end(), std::uint8_t{'\n'});
      line.assign(begin, end);
      at_ += line.size() + (end == bytes_.end() ? 0 : 1);
      if (!line.empty() && line.back() == '\r') line.pop_back();
      ++number_;
    } while (!line.empty() && line[0] == '#');
    return true;
  }
  // Returns the number of the last line, from 1.
  int number() const { return number_; }

 private:
  std::vector<std::uint8_t> bytes_;
  std::size_t at_ = 0;
  int number_ = 0;
};

Status read_cameras_text(const CaptureFolder& files, const std::string& path, ColmapModel& model) {
  STGS_ASSIGN(TextLines lines, TextLines::open(files, path));
  for (std::string line; lines.next(line);) {
    if (line.empty()) continue;
    std::istringstream words(line);
    std::uint32_t id = 0;
    ColmapCamera camera;
    words >> id >> camera.model >> camera.width >> camera.height;
    for (double v; words >> v;) camera.params.push_back(v);
    const ModelKind* kind = kind_of(camera.model);
    if (kind == nullptr || camera.params.size() != kind->params) {
      return invalid_file("{}:{}: not a camera (expected id, model, width, height, parameters)",
                          path, lines.number());
    }
    model.cameras[id] = std::move(camera);
  }
  return {};
}

Status read_images_text(const CaptureFolder& files, const std::string& path, ColmapModel& model) {
  STGS_ASSIGN(TextLines lines, TextLines::open(files, path));
  // Every second line lists features.
  for (std::string line, features; lines.next(line); (void)lines.next(features)) {
    std::istringstream words(line);
    ColmapImage image;
    std::uint32_t id = 0;
    words >> id;
    for (double& v : image.rotation) words >> v;
    for (double& v : image.translation) words >> v;
    words >> image.camera >> std::ws;
    if (!std::getline(words, image.name) || image.name.empty()) {
      const int number = lines.number();
      if (line.empty() && !lines.next(features)) break;
      return invalid_file(
          "{}:{}: not an image (expected id, quaternion, translation, camera, name)", path, number);
    }
    model.images.push_back(std::move(image));
  }
  return {};
}

Status read_points_text(const CaptureFolder& files, const std::string& path, ColmapModel& model) {
  STGS_ASSIGN(TextLines lines, TextLines::open(files, path));
  for (std::string line; lines.next(line);) {
    if (line.empty()) continue;
    std::istringstream words(line);
    std::uint64_t id = 0;
    InitialPoint point{};
    point.frame = -1;
    std::array<int, 3> colour{};
    words >> id >> point.position[0] >> point.position[1] >> point.position[2];
    for (int& v : colour) words >> v;
    if (!words) {
      return invalid_file("{}:{}: not a point (expected id, x y z, red green blue)", path,
                          lines.number());
    }
    for (int c = 0; c < 3; ++c) {
      point.colour[c] = static_cast<std::uint8_t>(std::clamp(colour[c], 0, 255));
    }
    model.points.push_back(point);
  }
  return {};
}

}  // namespace

bool is_colmap_model(const CaptureFolder& files, const std::string& folder) {
  const auto has = [&](const char* name) { return files.exists(folder + "/" + name); };
  return (has("cameras.bin") && has("images.bin")) || (has("cameras.txt") && has("images.txt"));
}

Result<ColmapModel> read_colmap_model(const CaptureFolder& files, const std::string& folder) {
  ColmapModel model;
  if (files.exists(folder + "/cameras.bin")) {
    STGS_TRY(read_cameras_binary(files, folder + "/cameras.bin", model));
    STGS_TRY(read_images_binary(files, folder + "/images.bin", model));
    const std::string points = folder + "/points3D.bin";
    if (files.exists(points)) STGS_TRY(read_points_binary(files, points, model));
  } else {
    STGS_TRY(read_cameras_text(files, folder + "/cameras.txt", model));
    STGS_TRY(read_images_text(files, folder + "/images.txt", model));
    const std::string points = folder + "/points3D.txt";
    if (files.exists(points)) STGS_TRY(read_points_text(files, points, model));
  }
  std::sort(
      model.images.begin(), model.images.end(),
      [](const ColmapImage& a, const ColmapImage& b) { return natural_less(a.name, b.name); });
  return model;
}

}  // namespace stgs::encoder
