// SPDX-License-Identifier: Apache-2.0
// A segment that has been read and checked but not decoded. Any device can decode its planes and
// map them to floats (spec 7).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "stgs/format/math/lang.h"
#include "stgs/format/rans_layout.h"

namespace stgs {

// The attributes of a primitive, in file order (spec 6.3).
enum class Attribute : std::uint16_t {
  kPosition = 1,  // 3 components
  kTime,          // centre T
  kSigma,         // width of the temporal falloff
  kRadius,        // half width of the flat top
  kVelocity,      // 3 components
  kLogScale,      // 3 components
  kRotation,      // quaternion, 4 components
  kOpacity,       // logit
  kSh0,           // SH of degree 0: 3 components
  kSh1,           // SH of degree 1: 9 components
  kSh2,           // SH of degree 2: 15 components
  kSh3,           // SH of degree 3: 21 components
};
// From this number on, readers skip unknown attributes.
inline constexpr std::uint16_t kOptionalAttributes = 0x8000;

// How an integer q becomes a float; step = multiplier * 2^exponent (spec 7.5). Numbers are never
// reused for another mapping.
enum class Mapping : std::uint8_t {
  kFloat = 0,           // the bits of a float32
  kLinear = 1,          // origin[c mod 3] + step q
  kTruncated = 2,       // as_float(bits(origin[0]) + step q) - origin[1]
  kDisplacement = 3,    // step q / 2^(log2 of the lifespan)
  kRotation = 4,        // vector part of a unit quaternion, in steps
  kColour = 5,          // RGB from one luma and two chroma integers, in steps
  kShapedRotation = 6,  // kRotation with finer steps for elongated primitives
  kTime = 7,            // kLinear, counted from the beginning of the segment
};
// How q follows from the values v of the planes (spec 7.4).
enum class Prediction : std::uint8_t {
  kPlain = 0,   // q = v
  kZigzag = 1,  // q = unzigzag(v)
  kDelta = 2,   // q = previous q + unzigzag(v)
  kMorton = 3,  // running sum of v from the record's first key, deinterleaved into three q
};

inline constexpr std::size_t kMaxDigits = 16;  // of a value
// Range of a step's exponent (spec 7.5). Within it no result is subnormal or infinite and every
// product is exact, so flushing subnormals or fusing multiply-adds does not change the result.
inline constexpr int kMinExponent = -100, kMaxExponent = 100;
// Range of the exponent of a rotation's step.
inline constexpr int kMinRotationExponent = -14, kMaxRotationExponent = -1;
// Range of log2 of the lifespan that scales a displacement (spec 7.5.4).
inline constexpr int kMinLifespanExponent = -32, kMaxLifespanExponent = 32;
// Bits of the greatest float that kTruncated produces: 2^100.
inline constexpr std::uint32_t kMaxTruncated = 0x71800000;

// The step size multiplier * 2^exponent.
struct Step {
  int exponent = 0;
  int multiplier = 1;  // 1 to 255, odd
  bool operator==(const Step&) const = default;
};

// Returns the greatest |q| of a mapping with this multiplier. It keeps products below 2^24, and
// below 2^22 for colours, because a channel is the sum of three.
STGS_FN std::uint32_t max_steps(Mapping mapping, int multiplier) {
  const std::uint32_t limit = (1u << (mapping == Mapping::kColour ? 22 : 24)) - 1;
  return limit / static_cast<std::uint32_t>(multiplier);
}

// One digit of one component of all primitives of a record.
struct CodedPlane {
  enum class Source : std::uint8_t {
    kConstant,  // every symbol is `only`
    kGroup,     // plane `number` of the record's rANS group
    kStored,    // plane `number` of CodedRecord::stored
  };
  Source source = Source::kConstant;
  std::uint8_t only = 0;     // the symbol of a kConstant plane
  std::uint32_t number = 0;  // of a kGroup or kStored plane
};

// One attribute of a record's primitives.
struct CodedStream {
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  Prediction prediction = Prediction::kPlain;
  Step step;
  std::size_t components = 0;                         // per primitive
  std::size_t digits = 0;                             // per value, lowest first
  std::array<std::uint8_t, kMaxDigits> digit_bits{};  // bits of each digit
  std::array<float, 3> origin{};
  std::vector<CodedPlane> planes;  // components x digits
};

// One record of a segment.
struct CodedRecord {
  std::vector<CodedStream> streams;       // in file order
  std::vector<std::uint8_t> bytes;        // of the rANS group; empty if the record has none
  std::vector<RansBlockLocation> blocks;  // of the group
  std::vector<std::uint16_t> tables;      // table number of each plane of the group
  bool own_tables = false;                // `tables` index `lookups` instead of the file's tables
  std::vector<RansLookup> lookups;        // empty unless own_tables
  std::vector<std::uint8_t> stored;       // planes not coded with rANS, one symbol per primitive
};

// A segment, ready for decoding.
struct CodedSegment {
  std::uint32_t primitives = 0;
  int sh_degree = 0;                 // of the file
  float part_ticks = 0;              // length of its part
  double begin = 0;                  // ticks from the beginning of its part, before cutting
  std::uint64_t first_key = 0;       // of positions with Prediction::kMorton
  std::vector<CodedRecord> records;  // the base record, then the SH record if there is one
};

// Undoes zigzag coding, which maps 0, -1, 1, -2 to 0, 1, 2, 3.
STGS_FN std::uint32_t unzigzag(std::uint32_t v) {
  return (v >> 1) ^ (0u - (v & 1u));
}

// Gathers every third bit of a Morton key, starting with bit 0: 21 bits.
STGS_FN std::uint32_t compact3(std::uint64_t v) {
  v &= 0x1249249249249249;
  v = (v | v >> 2) & 0x10C30C30C30C30C3;
  v = (v | v >> 4) & 0x100F00F00F00F00F;
  v = (v | v >> 8) & 0x1F0000FF0000FF;
  v = (v | v >> 16) & 0x1F00000000FFFF;
  v = (v | v >> 32) & 0x1FFFFF;
  return static_cast<std::uint32_t>(v);
}

// Returns the integer from which the times of a segment that starts at `begin` count (spec 7.5.8).
std::int64_t time_origin(double begin, Step step);

}  // namespace stgs
