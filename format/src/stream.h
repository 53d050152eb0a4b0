// SPDX-License-Identifier: Apache-2.0
// One attribute of a record's primitives: mapping to integers, prediction, planes of digits
// (spec 7). How the planes are coded is a matter of the record (segment.h).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "attributes.h"
#include "findings.h"
#include "stgs/format/coded_segment.h"

namespace stgs {

enum class Coder : std::uint8_t {
  kBytes = 0,  // a zstd frame of the planes, or the planes
  kRans = 1,   // in the record's group
  kDraco = 2,  // a Draco point cloud of the positions
};

inline constexpr int kMortonBits = 21;  // an axis
inline constexpr std::int64_t kMaxInteger = std::int64_t{1}
                                            << 24;  // |q| below it is exact in float32

// A stream of a layout (spec 6.3). What is not known, or need not be, has no more than the first
// six fields.
struct StreamRow {
  std::uint16_t attribute = 0;
  std::uint8_t components = 0;  // of the planes
  std::uint8_t mapping = 0, prediction = 0, coder = 0;
  bool known = true;  // to this version: what decoding the row means
  Step step;
  std::uint8_t digits = 0;  // of a value
  std::array<std::uint8_t, kMaxDigits> digit_bits{};
  float origin[3] = {0, 0, 0};
  std::vector<std::uint16_t> tables;  // of the planes, where the coder is kRans

  std::size_t planes() const { return std::size_t{components} * digits; }
  bool optional() const { return attribute >= kOptionalAttributes; }  // skipped (spec 6.5)
  bool in_group() const { return static_cast<Coder>(coder) == Coder::kRans; }
  bool operator==(const StreamRow&) const = default;
};

// One digit of one component of all primitives of a record; null: `only` for each of them.
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

// What the records of a segment are mapped with, beside their layouts.
struct SegmentContext {
  float part_ticks = 0;         // length of its part
  double begin = 0;             // of the segment, before its part cuts it; ticks of its part
  std::uint64_t first_key = 0;  // of the record (spec 6.5)
};
// Whether this version knows the attribute, mapping, prediction and coder of a row.
bool is_known(const StreamRow& row);
// That such a row keeps the rules for what it is.
bool check_row(const StreamRow& row, std::uint64_t offset, Findings& findings);
// A stream that is to be mapped: neither is owned.
struct StreamTask {
  const StreamRow* row = nullptr;
  const Plane* planes = nullptr;  // row->planes() of them
};
// What map_streams has found.
struct MapResult {
  std::vector<bool> in_range;  // by task: no integer of it is too large
  bool drawable = true;        // every primitive is one that can be drawn (values.h)
};
// From planes to floats in `set`, whose arrays have their size and are 0. Velocity needs sigma and
// radius, rotation the log-scales: these must come before.
MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      Gaussians4D& set);

// What a primitive of these log-scales adds to the exponent of its rotation (spec 7.5.7): a turn of
// what is nearly round is hard to see.
inline int rotation_shift(const float* log_scale) {
  const float least = std::min(std::min(log_scale[0], log_scale[1]), log_scale[2]);
  const float most = std::max(std::max(log_scale[0], log_scale[1]), log_scale[2]);
  const float length = most - least;
  return 3 - (length >= 0.125f) - (length >= 0.5f) - (length >= 1.25f) - (length >= 2.375f) -
         (length >= 3.75f) - (length >= 5.0f);
}
// floor(log2) of the lifespan that scales a displacement (spec 7.5.4).
inline int lifespan_exponent(float sigma, float radius, float part_ticks) {
  const float lifespan = std::min(radius + 2.0f * sigma, part_ticks);
  const int exponent = static_cast<int>(std::bit_cast<std::uint32_t>(lifespan) >> 23 & 0xFF) - 127;
  return std::clamp(exponent, kMinLifespanExponent, kMaxLifespanExponent);
}

constexpr std::uint32_t zigzag(std::int32_t q) {
  return (static_cast<std::uint32_t>(q) << 1) ^ static_cast<std::uint32_t>(q >> 31);
}
// Spreads the low 21 bits to every third bit.
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
