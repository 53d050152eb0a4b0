// SPDX-License-Identifier: Apache-2.0
// Initial points as binary little-endian PLY.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <memory>
#include <sstream>
#include <string_view>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/output_file.h"

namespace stgs::encoder {
namespace {

static_assert(std::endian::native == std::endian::little, "PLY bytes are copied as they are");

constexpr std::uint64_t kLongestHeader = 64 * 1024;

struct ScalarType {
  std::string_view name, alias;
  int bytes;
};
constexpr std::array<ScalarType, 8> kScalarTypes = {{{"char", "int8", 1},
                                                     {"uchar", "uint8", 1},
                                                     {"short", "int16", 2},
                                                     {"ushort", "uint16", 2},
                                                     {"int", "int32", 4},
                                                     {"uint", "uint32", 4},
                                                     {"float", "float32", 4},
                                                     {"double", "float64", 8}}};

// What a point is made of, and the type each must have in the file.
enum Field { kX, kY, kZ, kRed, kGreen, kBlue, kVx, kVy, kVz, kFrame, kFieldCount };
constexpr std::array<std::string_view, kFieldCount> kFieldName = {
    "x", "y", "z", "red", "green", "blue", "vx", "vy", "vz", "frame"};

std::string_view field_type(int field) {
  if (field >= kRed && field <= kBlue) return "uchar";
  return field == kFrame ? "int" : "float";
}

struct PlyLayout {
  std::uint64_t count = 0;
  std::uint64_t header_bytes = 0;
  std::uint64_t stride = 0;
  std::array<std::uint64_t, kFieldCount> offset;  // kAbsent where the file lacks the field
};
constexpr std::uint64_t kAbsent = ~std::uint64_t{0};

Status parse_property(std::istringstream& words, const std::string& path, PlyLayout& layout) {
  std::string type, name;
  words >> type >> name;
  const ScalarType* scalar = nullptr;
  for (const ScalarType& known : kScalarTypes) {
    if (type == known.name || type == known.alias) scalar = &known;
  }
  if (scalar == nullptr || name.empty()) {
    return invalid_file("{}: vertex property of type '{}' is not a scalar", path, type);
  }
  for (int field = 0; field < kFieldCount; ++field) {
    if (name != kFieldName[field]) continue;
    if (scalar->name != field_type(field)) {
      return invalid_file("{}: property '{}' is {}, but must be {}", path, name, type,
                          field_type(field));
    }
    layout.offset[field] = layout.stride;
  }
  layout.stride += static_cast<std::uint64_t>(scalar->bytes);
  return {};
}

Result<PlyLayout> parse_header(const std::string& text, const std::string& path) {
  PlyLayout layout;
  layout.offset.fill(kAbsent);
  const std::string_view end_mark = "end_header\n";
  const std::size_t end = text.find(end_mark);
  if (text.rfind("ply\n", 0) != 0 || end == std::string::npos) {
    return invalid_file("{}: is not a PLY file, or its header is truncated", path);
  }
  layout.header_bytes = end + end_mark.size();
  std::istringstream lines(text.substr(0, end));
  std::string line;
  bool binary = false, vertices = false;
  while (std::getline(lines, line)) {
    std::istringstream words(line);
    std::string keyword, name;
    words >> keyword;
    if (keyword == "format") {
      words >> name;
      binary = name == "binary_little_endian";
    } else if (keyword == "element") {
      words >> name;
      if (vertices || name != "vertex") {
        return invalid_file("{}: has an element '{}'; only one, 'vertex', is read", path, name);
      }
      vertices = true;
      if (!(words >> layout.count)) return invalid_file("{}: the vertex count is no number", path);
    } else if (keyword == "property") {
      if (!vertices) return invalid_file("{}: a property comes before its element", path);
      STGS_TRY(parse_property(words, path, layout));
    }
  }
  if (!binary) return unsupported("{}: only binary little-endian PLY is read", path);
  for (int field = kX; field <= kBlue; ++field) {
    if (layout.offset[field] == kAbsent) {
      return invalid_file("{}: has no property '{}'", path, kFieldName[field]);
    }
  }
  for (int field = kVx; field < kFieldCount; ++field) {
    if ((layout.offset[field] == kAbsent) != (layout.offset[kVx] == kAbsent)) {
      return invalid_file("{}: needs all of vx, vy, vz and frame, or none of them", path);
    }
  }
  return layout;
}

template <typename T>
T load(const std::uint8_t* record, std::uint64_t offset) {
  T value;
  std::memcpy(&value, record + offset, sizeof(T));
  return value;
}

template <typename T>
void store(std::vector<std::uint8_t>& bytes, const T& value) {
  const auto* p = reinterpret_cast<const std::uint8_t*>(&value);
  bytes.insert(bytes.end(), p, p + sizeof(T));
}

InitialPoint decode_point(const std::uint8_t* record, const PlyLayout& layout) {
  InitialPoint point{};
  point.frame = -1;
  for (int i = 0; i < 3; ++i) {
    point.position[i] = load<float>(record, layout.offset[kX + i]);
    point.colour[i] = load<std::uint8_t>(record, layout.offset[kRed + i]);
  }
  if (layout.offset[kFrame] == kAbsent) return point;
  for (int i = 0; i < 3; ++i) point.velocity[i] = load<float>(record, layout.offset[kVx + i]);
  point.frame = load<std::int32_t>(record, layout.offset[kFrame]);
  return point;
}

bool finite(const InitialPoint& point) {
  const auto is_finite = [](float v) { return std::isfinite(v); };
  return std::all_of(point.position, point.position + 3, is_finite) &&
         std::all_of(point.velocity, point.velocity + 3, is_finite);
}

}  // namespace

Result<std::vector<InitialPoint>> read_points(const std::string& path) {
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_file(path));
  std::string head(std::min(source->size(), kLongestHeader), '\0');
  STGS_TRY(source->read(0, {reinterpret_cast<std::uint8_t*>(head.data()), head.size()}));
  STGS_ASSIGN(const PlyLayout layout, parse_header(head, path));
  const std::uint64_t left = source->size() - layout.header_bytes;
  if (layout.count > left / layout.stride) {
    return invalid_file("{}: says {} points of {} bytes, but only {} bytes follow the header", path,
                        layout.count, layout.stride, left);
  }
  std::vector<std::uint8_t> bytes(layout.count * layout.stride);
  STGS_TRY(source->read(layout.header_bytes, bytes));
  std::vector<InitialPoint> points(layout.count);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i] = decode_point(bytes.data() + i * layout.stride, layout);
    if (!finite(points[i])) {
      return invalid_file("{}: point {} has a position or velocity that is not a number", path, i);
    }
  }
  return points;
}

Status write_points(const std::string& path, const std::vector<InitialPoint>& points) {
  bool moving = false;
  for (const InitialPoint& point : points) moving |= point.frame >= 0;
  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex " +
                       std::to_string(points.size()) + "\n";
  for (int field = 0; field < (moving ? kFieldCount : kVx); ++field) {
    header += fmt::format("property {} {}\n", field_type(field), kFieldName[field]);
  }
  header += "end_header\n";
  std::vector<std::uint8_t> bytes(header.begin(), header.end());
  for (const InitialPoint& point : points) {
    for (float v : point.position) store(bytes, v);
    for (std::uint8_t v : point.colour) store(bytes, v);
    if (!moving) continue;
    for (float v : point.velocity) store(bytes, v);
    store(bytes, static_cast<std::int32_t>(point.frame));
  }
  return write_file_atomically(path, bytes);
}

}  // namespace stgs::encoder
