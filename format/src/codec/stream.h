// SPDX-License-Identifier: Apache-2.0
// One attribute of a record's primitives: mapping to integers, prediction, planes of digits (spec
// 8). The record determines how planes are coded (segment.h).
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
  kBytes = 0,  // the planes as they are
  kRans = 1,   // in a group of planes
  kDraco = 2,  // a Draco point cloud of the positions
};

// A stream of a layout (spec 6.2). Unknown streams have the attribute, mapping, prediction and
// coder only.
struct StreamRow {
  std::uint16_t attribute = 0;
  std::uint8_t components = 0;  // per primitive, of `digits` planes; one with kMorton
  std::uint8_t mapping = 0, prediction = 0, coder = 0;
  bool joins = false;  // in the group of the stream before
  bool known = true;   // this version can decode it
  Step step;
  std::uint8_t low = 0;     // bits of the low components, with kMorton
  std::uint8_t digits = 0;  // per value
  std::array<std::uint8_t, kMaxDigits> digit_bits{};
  float origin[3] = {0, 0, 0};
  std::vector<std::uint16_t> tables;  // by plane, if the coder is kRans

  std::size_t low_digits() const { return (std::size_t{low} + 7) / 8; }  // of a low component
  std::size_t planes() const { return std::size_t{components} * digits + 3 * low_digits(); }
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
  bool morton = false;                // positions in ascending order of their keys, q >= 0

  std::size_t size() const {
    return components == 0 ? 0 : values.size() / static_cast<std::size_t>(components);
  }
};

// Parameters of mapping the records of a segment, besides their layouts.
struct SegmentContext {
  int part_exponent = 0;                        // floor(log2) of the length of its part
  double begin = 0;                             // of the segment, before cutting; ticks of its part
  double time_origin = 0;                       // Gaussians4D::time_origin
  std::uint32_t first_key = 0;                  // of the record (spec 8.4)
  std::array<std::uint32_t, 6> shape_bounds{};  // of the step of the log scales
};
// Returns whether this version knows the attribute, mapping, prediction and coder of a row.
bool is_known(const StreamRow& row);
// Returns the components of a known row that have `digits` planes each (spec 8.1).
int components_in_planes(const StreamRow& row);
// Checks the rules for a known row.
bool check_row(const StreamRow& row, std::uint64_t offset, Findings& findings);
// A stream to map. The pointers are not owned.
struct StreamTask {
  const StreamRow* row = nullptr;
  const Plane* planes = nullptr;  // row->planes() of them
  // The primitives with a value, ascending; empty: all of them.
  std::span<const std::uint32_t> members;
};
struct MapResult {
  std::vector<bool> in_range;  // by task: all integers are within the range of the mapping
  bool renderable = true;      // all primitives pass check_primitives() (values.h)
};
inline constexpr std::size_t kMaxComponents = 21;  // of an attribute
// The value of each component before the first primitive, for predictions that depend on it.
using Carries = std::array<std::uint32_t, kMaxComponents>;
// Returns the carries of tasks at the beginning of a record.
std::vector<Carries> first_carries(std::span<const StreamTask> tasks,
                                   const SegmentContext& context);
// Maps planes of n primitives to floats in `set`, whose arrays have their final size. With SH of
// degree 0, SH without a value become 0. Velocity depends on sigma and radius, rotation on the log
// scales: tasks are in the order of attributes. `carries`: of each task, updated to those after the
// n primitives if none has members.
MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      std::size_t n, Gaussians4D& set, std::vector<Carries>& carries);
// Maps all primitives of a record.
MapResult map_streams(std::span<const StreamTask> tasks, const SegmentContext& context,
                      std::size_t n, Gaussians4D& set);

// Returns the number added to the exponent of a rotation's step, from the difference of the
// greatest and the least integer of its log scales (spec 8.8). It is greater for nearly round
// primitives, whose rotation is hard to see.
inline int rotation_shift(const std::array<std::uint32_t, 6>& bounds, std::uint32_t spread) {
  int out = 3;
  for (const std::uint32_t bound : bounds) out -= spread >= bound ? 1 : 0;
  return out;
}
// Radius is stored as the float radius + kRadiusOffset, so that radius 0 has finite relative steps.
inline constexpr float kRadiusOffset = 1.0f;
// Returns the exponent of the lifespan that scales a displacement, for values on their grids.
inline int lifespan_exponent_of(float sigma, float radius, int part_exponent) {
  return lifespan_exponent(std::bit_cast<std::uint32_t>(sigma),
                           std::bit_cast<std::uint32_t>(radius + kRadiusOffset), part_exponent);
}
// Returns floor(log2(ticks)), ticks > 0.
int part_exponent_of(double ticks);

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
// Gathers every third bit, starting with bit 0: 21 bits.
constexpr std::uint32_t compact_key(std::uint64_t v) {
  v &= 0x1249249249249249;
  v = (v | v >> 2) & 0x10C30C30C30C30C3;
  v = (v | v >> 4) & 0x100F00F00F00F00F;
  v = (v | v >> 8) & 0x1F0000FF0000FF;
  v = (v | v >> 16) & 0x1F00000000FFFF;
  v = (v | v >> 32) & 0x1FFFFF;
  return static_cast<std::uint32_t>(v);
}
constexpr std::uint64_t morton_key(std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  return spread3(x) | spread3(y) << 1 | spread3(z) << 2;
}

}  // namespace stgs
