// SPDX-License-Identifier: Apache-2.0
#include "codec/draco_points.h"

#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <draco/point_cloud/point_cloud_builder.h>

#include <algorithm>
#include <array>
#include <exception>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>

#include "codec/stream.h"
#include "core/bytes.h"

namespace stgs {
namespace {

constexpr std::size_t kMaxPoints =
    std::numeric_limits<std::int32_t>::max() / kDracoComponents;  // Draco counts coordinates
constexpr std::uint8_t kMaxTreeLevel = 6;  // compression level of the kd-tree

using Point = std::array<std::uint32_t, kDracoComponents>;

// Assembles the point of a primitive from its digits.
Point point_of(std::span<const std::uint8_t> planes, std::size_t n, std::size_t i) {
  Point point{};
  for (std::size_t p = 0; p < kDracoPlanes; ++p) {
    point[p / kDracoDigits] |= std::uint32_t{planes[p * n + i]} << (8 * (p % kDracoDigits));
  }
  return point;
}

void put_point(const Point& point, std::size_t n, std::size_t i, std::span<std::uint8_t> planes) {
  for (std::size_t p = 0; p < kDracoPlanes; ++p) {
    planes[p * n + i] =
        static_cast<std::uint8_t>(point[p / kDracoDigits] >> (8 * (p % kDracoDigits)));
  }
}

// Decodes points to Morton keys. Returns the problem, or null.
const char* decode_keys(std::span<const std::uint8_t> stored, std::vector<std::uint64_t>& keys) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(stored.data()), stored.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodePointCloudFromBuffer(&buffer);
  if (!decoded.ok()) return "Draco cannot decode the point cloud";
  const draco::PointCloud& cloud = *decoded.value();
  if (buffer.remaining_size() != 0) return "extra bytes after the point cloud";
  const draco::PointAttribute* const points =
      cloud.num_attributes() == 1 ? cloud.attribute(0) : nullptr;
  if (points == nullptr || cloud.num_points() != keys.size() || points->size() != keys.size() ||
      points->num_components() != kDracoComponents || points->data_type() != draco::DT_UINT32 ||
      !points->is_mapping_identity()) {
    return "the point cloud does not match its header";
  }
  for (std::size_t i = 0; i < keys.size(); ++i) {
    Point q{};
    points->GetValue(draco::AttributeValueIndex(static_cast<std::uint32_t>(i)), q.data());
    if ((q[0] | q[1] | q[2]) >> kPositionBits != 0) return "a coordinate exceeds 21 bits";
    keys[i] = morton_key(q[0], q[1], q[2]);
  }
  return nullptr;
}

}  // namespace

Status check_draco() {
  return {};
}

std::vector<std::uint8_t> draco_encode(std::span<const std::uint8_t> planes, std::size_t n,
                                       int speed) {
  if (n > kMaxPoints) throw std::runtime_error("too many positions in a record for Draco");
  draco::PointCloudBuilder builder;
  builder.Start(static_cast<std::uint32_t>(n));
  const int attribute =
      builder.AddAttribute(draco::GeometryAttribute::POSITION, kDracoComponents, draco::DT_UINT32);
  for (std::size_t i = 0; i < n; ++i) {
    const Point point = point_of(planes, n, i);
    builder.SetAttributeValueForPoint(attribute, draco::PointIndex(static_cast<std::uint32_t>(i)),
                                      point.data());
  }
  const std::unique_ptr<draco::PointCloud> cloud = builder.Finalize(false);
  if (cloud == nullptr) throw std::runtime_error("Draco rejects the points");
  draco::ExpertEncoder encoder(*cloud);
  encoder.SetEncodingMethod(draco::POINT_CLOUD_KD_TREE_ENCODING);
  encoder.SetSpeedOptions(speed, speed);
  draco::EncoderBuffer buffer;
  const draco::Status status = encoder.EncodeToBuffer(&buffer);
  if (!status.ok()) throw std::runtime_error("Draco: " + status.error_msg_string());
  const auto* const begin = reinterpret_cast<const std::uint8_t*>(buffer.data());
  std::vector<std::uint8_t> out(begin, begin + buffer.size());
  if (!draco_fits(out, n)) {
    throw std::runtime_error("this version of Draco writes an unsupported bitstream");
  }
  return out;
}

bool draco_fits(std::span<const std::uint8_t> stored, std::size_t n) {  // spec, annex C
  // Magic, version 2.3, point cloud, kd-tree coding, no flags. After the point count: one decoder
  // with one attribute, a position of 3 u32, not normalised, with id 0.
  constexpr std::uint8_t kForm[] = {'D', 'R', 'A', 'C', 'O', 2, 3, 0, 1, 0, 0};
  constexpr std::uint8_t kAttribute[] = {1, 1, 0, draco::DT_UINT32, kDracoComponents, 0, 0};
  ByteReader in(stored);
  const auto form = in.bytes(sizeof kForm);
  const std::uint32_t points = in.u32();
  const auto attribute = in.bytes(sizeof kAttribute);
  const std::uint8_t level = in.u8();
  const std::uint32_t bits = in.u32(), points_again = in.u32();
  return in.ok() && n <= kMaxPoints && points == n && points_again == n && level <= kMaxTreeLevel &&
         bits <= static_cast<std::uint32_t>(kPositionBits) &&
         std::equal(form.begin(), form.end(), std::begin(kForm)) &&
         std::equal(attribute.begin(), attribute.end(), std::begin(kAttribute));
}

const char* draco_decode(std::span<const std::uint8_t> stored, std::size_t n,
                         std::span<std::uint8_t> planes) {
  std::vector<std::uint64_t> keys(n);
  try {
    if (const char* problem = decode_keys(stored, keys)) return problem;
  } catch (const std::bad_alloc&) {
    throw;  // not caused by the bytes, which state n points
  } catch (const std::exception&) {
    return "Draco failed to decode the point cloud";
  }
  std::sort(keys.begin(), keys.end());
  for (std::size_t i = 0; i < n; ++i) {
    put_point({compact_key(keys[i]), compact_key(keys[i] >> 1), compact_key(keys[i] >> 2)}, n, i,
              planes);
  }
  return nullptr;
}

}  // namespace stgs
