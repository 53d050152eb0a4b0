// SPDX-License-Identifier: Apache-2.0
// A segment that has been read and checked but not decoded. Any device can decode its planes and
// map them to floats (spec 8).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "stgs/format/math/lang.h"
#include "stgs/format/rans_layout.h"

namespace stgs {

// The streams of a record, in file order (spec 6.3).
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
  kShDegree,      // SH degree of the primitive; not an attribute of Gaussians4D
  kSh1,           // SH of degree 1: 9 components
  kSh2,           // SH of degree 2: 15 components
  kSh3,           // SH of degree 3: 21 components
};
// From this number on, readers skip unknown attributes.
inline constexpr std::uint16_t kOptionalAttributes = 0x8000;

// How an integer q becomes a float; step = multiplier * 2^exponent (spec 8.5). Numbers are never
// reused for another mapping.
enum class Mapping : std::uint8_t {
  kFloat = 0,           // the bits of a float32 without its lowest `exponent` bits, which are 0
  kLinear = 1,          // origin[c mod 3] + step q
  kTruncated = 2,       // as_float(bits(origin[0]) + step q) - origin[1]
  kDisplacement = 3,    // step q / 2^(exponent of the lifespan)
  kRotation = 4,        // vector part of a unit quaternion, in steps
  kColour = 5,          // RGB from one luma and two chroma integers, in steps
  kShapedRotation = 6,  // kRotation with finer steps for elongated primitives
  kTime = 7,            // kLinear, counted from the beginning of the segment
  kInteger = 8,         // q
};
// How q follows from the values v of the planes (spec 8.3).
enum class Prediction : std::uint8_t {
  kPlain = 0,   // q = v
  kZigzag = 1,  // q = unzigzag(v)
  kDelta = 2,   // q = previous q + unzigzag(v)
  kMorton = 3,  // high bits from a running sum of v, deinterleaved; low bits stored (spec 8.4)
};

inline constexpr std::size_t kMaxDigits = 8;  // of a value
inline constexpr int kKeyBits = 10;           // of a Morton key, per axis
inline constexpr int kMaxLowBits = 14;        // of a position below its key, per axis
// Bits of a position in steps, per axis: what Draco codes, and what a near-lossless file may have.
inline constexpr int kPositionBits = 21, kFinePositionBits = kKeyBits + kMaxLowBits;
// Returns the bits that a quantised or a near-lossless file may have.
constexpr int position_bits(bool near_lossless) {
  return near_lossless ? kFinePositionBits : kPositionBits;
}
inline constexpr int kShBands = 3;  // above degree 0
// Range of a step's exponent (spec 8.5). Within it no result is subnormal or infinite and every
// product is exact, so flushing subnormals or fusing multiply-adds does not change the result.
inline constexpr int kMinExponent = -100, kMaxExponent = 100;
// Range of the exponent of a rotation's step.
inline constexpr int kMinRotationExponent = -14, kMaxRotationExponent = -1;
// Range of the exponent of the lifespan that scales a displacement (spec 8.6).
inline constexpr int kMinLifespanExponent = -32, kMaxLifespanExponent = 32;
// Bits of the greatest float that kTruncated produces: 2^100.
inline constexpr std::uint32_t kMaxTruncated = 0x71800000;
// Greatest exponent of kFloat: the number of low bits that are not stored.
inline constexpr int kMaxDroppedBits = 20;

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

// One digit of one component of all primitives of a stream.
struct CodedPlane {
  enum class Source : std::uint8_t {
    kConstant,  // every symbol is `only`
    kGroup,     // decoded from a group
    kStored,    // in CodedRecord::stored
  };
  Source source = Source::kConstant;
  std::uint8_t only = 0;  // the symbol of a kConstant plane
  // Of the first symbol: in CodedRecord::stored, or in the decoded groups of the record one after
  // the other.
  std::size_t offset = 0;
};

// One attribute of a record's primitives.
struct CodedStream {
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  Prediction prediction = Prediction::kPlain;
  Step step;
  std::uint32_t symbols = 0;           // of a plane
  std::vector<std::uint32_t> members;  // the primitives with a value; empty: all of them
  std::size_t components = 0;          // per primitive
  std::size_t digits = 0;              // per value, lowest first
  int low = 0;                         // bits of the low components, with kMorton
  std::array<std::uint8_t, kMaxDigits> digit_bits{};  // bits of each digit
  std::array<float, 3> origin{};
  std::vector<CodedPlane> planes;  // components x digits, then those of the low components
};

// A rANS group of a record.
struct CodedGroup {
  std::size_t offset = 0, size = 0;       // in CodedRecord::bytes; the offset is even
  std::vector<RansBlockLocation> blocks;  // relative to the group
  std::vector<std::uint16_t> tables;      // table number of each plane
  std::uint32_t symbols = 0;              // of a plane
};

// One record of a segment.
struct CodedRecord {
  std::vector<CodedStream> streams;  // in file order
  std::vector<CodedGroup> groups;
  std::vector<std::uint8_t> bytes;   // of the groups
  bool own_tables = false;           // tables are in `lookups`, not in the file's tables
  std::vector<RansLookup> lookups;   // empty unless own_tables
  std::vector<std::uint8_t> stored;  // planes not coded with rANS, one symbol per primitive
};

// A primitive that ends: SegmentEnd with a time that counts as the decoded ones.
struct CodedEnd {
  std::uint32_t primitive = 0;
  float time = 0;
};

// A segment, ready for decoding.
struct CodedSegment {
  std::uint32_t primitives = 0;
  int sh_degree = 0;            // of the file
  int part_exponent = 0;        // floor(log2) of the length of its part, ticks
  double begin = 0;             // ticks from the beginning of its part, before cutting
  double time_origin = 0;       // of its decoded times: Gaussians4D::time_origin
  std::uint32_t first_key = 0;  // of positions with Prediction::kMorton
  std::array<std::uint32_t, 6> shape_bounds{};  // of the step of the log scales
  std::vector<CodedEnd> ends;        // ascending by primitive; apply them to the decoded set
  std::vector<CodedRecord> records;  // the base record, then the SH record if there is one
};

// Undoes zigzag coding, which maps 0, -1, 1, -2 to 0, 1, 2, 3.
STGS_FN std::uint32_t unzigzag(std::uint32_t v) {
  return (v >> 1) ^ (0u - (v & 1u));
}

// Gathers every third bit of a Morton key, starting with bit 0: 10 bits (spec 8.4).
STGS_FN std::uint32_t compact3(std::uint32_t v) {
  v &= 0x09249249;
  v = (v | v >> 2) & 0x030C30C3;
  v = (v | v >> 4) & 0x0300F00F;
  v = (v | v >> 8) & 0x030000FF;
  return (v | v >> 16) & 0x3FF;
}

// Returns the exponent of a positive float from its bits.
STGS_FN int exponent_of_bits(std::uint32_t bits) {
  return static_cast<int>(bits >> 23 & 0xFF) - 127;
}
// Returns the exponent of the lifespan that scales a displacement, from the bits b of sigma and
// radius (spec 8.6).
STGS_FN int lifespan_exponent(std::uint32_t sigma, std::uint32_t radius, int part_exponent) {
  const int falloff = exponent_of_bits(sigma) + 1, flat = exponent_of_bits(radius);
  const int longer = falloff > flat ? falloff : flat;
  const int out = longer < part_exponent ? longer : part_exponent;
  return out < kMinLifespanExponent   ? kMinLifespanExponent
         : out > kMaxLifespanExponent ? kMaxLifespanExponent
                                      : out;
}

// Returns the least differences of the integers of log scales, in steps of this size, at which the
// exponent of a rotation falls by 1 each (spec 8.8).
std::array<std::uint32_t, 6> shape_bounds(Step log_scale);

// Returns the time from which the times of a segment that starts at `begin` count, ticks: the
// greatest multiple of the step not above `begin` (spec 8.9).
double time_base(double begin, Step step);

}  // namespace stgs
