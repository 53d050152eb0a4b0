// SPDX-License-Identifier: Apache-2.0
// Initial points as binary little-endian PLY.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <memory>
#include <string_view>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/output_file.h"
#include "stgs/format/ply_header.h"

namespace stgs::encoder {
namespace {

constexpr float kUnitTolerance = 1e-5f;  // of the length of a normal

static_assert(std::endian::native == std::endian::little,
              "PLY values are copied without byte swapping");

// The vertex properties of the file.
enum Field { kX, kY, kZ, kRed, kGreen, kBlue, kVx, kVy, kVz, kFrame, kNx, kNy, kNz, kFieldCount };
constexpr std::array<std::string_view, kFieldCount> kFieldName = {
    "x", "y", "z", "red", "green", "blue", "vx", "vy", "vz", "frame", "nx", "ny", "nz"};

PlyType field_type(int field) {
  if (field >= kRed && field <= kBlue) return PlyType::kUint8;
  return field == kFrame ? PlyType::kInt32 : PlyType::kFloat32;
}
constexpr std::string_view name_of(PlyType type) {
  return type == PlyType::kUint8 ? "uchar" : type == PlyType::kInt32 ? "int" : "float";
}

struct PlyLayout {
  std::uint64_t count = 0;
  std::uint64_t begin = 0;  // offset of the first record, bytes
  std::uint64_t stride = 0;
  std::array<std::uint64_t, kFieldCount> offset;  // in the record, bytes; kAbsent: not in the file
};
constexpr std::uint64_t kAbsent = ~std::uint64_t{0};

// Returns whether the file has all fields of [first, last] or none.
bool complete(const PlyLayout& layout, int first, int last) {
  const auto is_absent = [](std::uint64_t offset) { return offset == kAbsent; };
  const auto begin = layout.offset.begin() + first, end = layout.offset.begin() + last + 1;
  return std::all_of(begin, end, is_absent) || std::none_of(begin, end, is_absent);
}

// Locates the properties that write_points writes. Their order in the file does not matter.
Result<PlyLayout> layout_of(const PlyHeader& header, const std::string& path) {
  if (header.ascii)
    return unsupported("{}: ASCII PLY is not supported (expected binary little-endian)", path);
  for (const PlyElement& element : header.elements) {
    if (element.name == "vertex") continue;
    return invalid_file("{}: unexpected element '{}' (expected only 'vertex')", path, element.name);
  }
  const PlyElement* const vertex = header.find("vertex");
  if (vertex == nullptr) return invalid_file("{}: element 'vertex' is missing", path);
  if (vertex->has_lists)
    return invalid_file("{}: a vertex property is a list (expected scalars)", path);
  PlyLayout layout{vertex->count, vertex->offset, vertex->stride, {}};
  layout.offset.fill(kAbsent);
  for (int field = 0; field < kFieldCount; ++field) {
    const PlyProperty* const property = vertex->find(kFieldName[field]);
    if (property == nullptr) continue;
    if (property->type != field_type(field)) {
      return invalid_file("{}: property '{}' has the wrong type (expected {})", path,
                          property->name, name_of(field_type(field)));
    }
    layout.offset[field] = property->offset;
  }
  for (int field = kX; field <= kBlue; ++field) {
    if (layout.offset[field] == kAbsent) {
      return invalid_file("{}: property '{}' is missing", path, kFieldName[field]);
    }
  }
  if (!complete(layout, kVx, kFrame)) {
    return invalid_file("{}: incomplete velocity (expected all of vx, vy, vz and frame, or none)",
                        path);
  }
  if (!complete(layout, kNx, kNz)) {
    return invalid_file("{}: incomplete normal (expected all of nx, ny and nz, or none)", path);
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
  if (layout.offset[kFrame] != kAbsent) {
    for (int i = 0; i < 3; ++i) point.velocity[i] = load<float>(record, layout.offset[kVx + i]);
    point.frame = load<std::int32_t>(record, layout.offset[kFrame]);
  }
  if (layout.offset[kNx] != kAbsent) {
    for (int i = 0; i < 3; ++i) point.normal[i] = load<float>(record, layout.offset[kNx + i]);
    const float length = std::hypot(point.normal[0], point.normal[1], point.normal[2]);
    // Unit normals keep their bits.
    if (length > 0.0f && std::abs(length - 1.0f) > kUnitTolerance)
      for (float& n : point.normal) n /= length;
  }
  return point;
}

bool finite(const InitialPoint& point) {
  const auto is_finite = [](float v) { return std::isfinite(v); };
  return std::all_of(point.position, point.position + 3, is_finite) &&
         std::all_of(point.velocity, point.velocity + 3, is_finite) &&
         std::all_of(point.normal, point.normal + 3, is_finite);
}

}  // namespace

Result<std::vector<InitialPoint>> read_points(const std::string& path) {
  STGS_ASSIGN(const std::unique_ptr<ByteSource> source, open_file(path));
  return read_points(*source);
}

Result<std::vector<InitialPoint>> read_points(const ByteSource& file) {
  const std::string& path = file.name();
  STGS_ASSIGN(const PlyHeader header, read_ply_header(file));
  STGS_ASSIGN(const PlyLayout layout, layout_of(header, path));
  std::vector<std::uint8_t> bytes(layout.count * layout.stride);
  STGS_TRY(file.read(layout.begin, bytes));
  std::vector<InitialPoint> points(layout.count);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i] = decode_point(bytes.data() + i * layout.stride, layout);
    if (!finite(points[i])) {
      return invalid_file("{}: point {} has a non-finite position, velocity or normal", path, i);
    }
  }
  return points;
}

Status write_points(const std::string& path, const std::vector<InitialPoint>& points) {
  bool moving = false, with_normals = false;
  for (const InitialPoint& point : points) {
    moving |= point.frame >= 0;
    with_normals |= point.normal[0] != 0 || point.normal[1] != 0 || point.normal[2] != 0;
  }
  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex " +
                       std::to_string(points.size()) + "\n";
  for (int field = 0; field < kFieldCount; ++field) {
    if (field >= kNx ? !with_normals : field >= kVx && !moving) continue;
    header += fmt::format("property {} {}\n", name_of(field_type(field)), kFieldName[field]);
  }
  header += "end_header\n";
  std::vector<std::uint8_t> bytes(header.begin(), header.end());
  for (const InitialPoint& point : points) {
    for (float v : point.position) store(bytes, v);
    for (std::uint8_t v : point.colour) store(bytes, v);
    if (moving) {
      for (float v : point.velocity) store(bytes, v);
      store(bytes, static_cast<std::int32_t>(point.frame));
    }
    if (!with_normals) continue;
    for (float v : point.normal) store(bytes, v);
  }
  return write_file_atomically(path, bytes);
}

}  // namespace stgs::encoder
