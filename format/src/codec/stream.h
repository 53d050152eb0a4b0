// SPDX-License-Identifier: Apache-2.0
// One attribute of a record's primitives: mapping to integers, prediction, planes of digits (spec
// 7). The record determines how planes are coded (segment.h).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/attributes.h"
#include "container/findings.h"
#include "stgs/format/coded_segment.h"

namespace stgs {

// The coder of a stream's planes.
enum class Coder : std::uint8_t {
  kBytes = 0,  // a zstd frame of the planes, or the raw planes
  kRans = 1,   // in the record's group
  kDraco = 2,  // a Draco point cloud of the positions
};

inline constexpr int kMortonBits = 21;  // per axis
// Integers |q| below this are exact in float32.
inline constexpr std::int64_t kMaxInteger = std::int64_t{1} << 24;

// A stream of a layout (spec 6.3). Unknown streams have the first six fields only.
struct StreamRow {
  std::uint16_t attribute = 0;
  std::uint8_t components = 0;  // per primitive
  std::uint8_t mapping = 0, prediction = 0, coder = 0;
  bool known = true;  // this version can decode it
  Step step;
  std::uint8_t digits = 0;  // per value
  std::array<std::uint8_t, kMaxDigits> digit_bits{};
  float origin[3] = {0, 0, 0};
  std::vector<std::uint16_t> tables;  // by plane, if the coder is kRans

  std::size_t planes() const { return std::size_t{components} * digits; }
  bool optional() const { return attribute >= kOptionalAttributes; }  // skipped (spec 6.5)
  bool in_group() const { return static_cast<Coder>(coder) == Coder::kRans; }
  bool operator==(const StreamRow&) const = default;
};

// One digit of one component of all primitives of a record. If `symbols` is null, all are `only`.
struct Plane {
  const std::uint8_t* symbols = nullptr;
  std::uint8_t only = 0;
};

// An attribute as integers, before prediction.
struct Integers {
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  Step step;
  float origin[3] = {0, 0, 0};
  int components = 0;
  std::vector<std::uint32_t> values;  // one component after the other, two's complement
  std::vector<std::uint64_t> morton;  // instead of values: ascending keys
};

// Parameters of mapping the records of a segment, besides their layouts.
struct SegmentContext {
  float part_ticks = 0;         // length of its part
  double begin = 0;             // of the segment, before cutting; ticks of its part
  std::uint64_t first_key = 0;  // of the record (spec 6.5)
};
// Returns whether this version knows the attribute, mapping, prediction and coder of a row.
bool is_known(const StreamRow& row);
// Checks the rules for a known row.
bool check_row(const StreamRow& row, std::uint64_t offset, Findings& findings);
// A stream to map. The pointers are not owned.
struct StreamTask {
  const StreamRow* row = nullptr;
  const Plane* planes = nullptr;  // row->planes() of them
};
struct MapResult {
  std::vector<bool> in_range;  // by task: all integers are within the range of the mapping
  bool renderable = true;      // all primitives pass check_primitives() (values.h)
};
// Maps planes to floats in `set`, whose arrays have their final size and are 0. Velocity depends on
// sigma and radius, rotation on the log scales: those tasks must come first.
MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      Gaussians4D& set);

// Returns the number added to the exponent of a rotation's step (spec 7.5.7). It is greater for
// nearly round primitives, whose rotation is hard to see.
inline int rotation_shift(const float* log_scale) {
  const float low = std::min(std::min(log_scale[0], log_scale[1]), log_scale[2]);
  const float high = std::max(std::max(log_scale[0], log_scale[1]), log_scale[2]);
  const float length = high - low;
  return 3 - (length >= 0.125f) - (length >= 0.5f) - (length >= 1.25f) - (length >= 2.375f) -
         (length >= 3.75f) - (length >= 5.0f);
}
// Returns floor(log2) of the lifespan that scales a displacement (spec 7.5.4).
inline int lifespan_exponent(float sigma, float radius, float part_ticks) {
  const float lifespan = std::min(radius + 2.0f * sigma, part_ticks);
  const int exponent = static_cast<int>(std::bit_cast<std::uint32_t>(lifespan) >> 23 & 0xFF) - 127;
  return std::clamp(exponent, kMinLifespanExponent, kMaxLifespanExponent);
}

// Maps 0, -1, 1, -2 to 0, 1, 2, 3.
constexpr std::uint32_t zigzag(std::int32_t q) {
  return (static_cast<std::uint32_t>(q) << 1) ^ static_cast<std::uint32_t>(q >> 31);
}
// Moves the low 21 bits to every third bit.
constexpr std::uint64_t spread3(std::uint64_t v) {
  v &= 0x1FFFFF;
  v = (v | v << 32) & 0x1F00000000FFFF;
  v = (v | v << 16) & 0x1F0000FF0000FF;
  v = (v | v << 8) & 0x100F00F00F00F00F;
  v = (v | v << 4) & 0x10C30C30C30C30C3;
  v = (v | v << 2) & 0x1249249249249249;
  return v;
}
constexpr std::uint64_t morton_key(std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  return spread3(x) | spread3(y) << 1 | spread3(z) << 2;
}

}  // namespace stgs
