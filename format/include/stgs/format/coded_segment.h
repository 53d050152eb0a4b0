// SPDX-License-Identifier: Apache-2.0
// A segment as it is stored, read and checked: what is left to do is decoding its planes and
// mapping them to numbers (spec 7), on whatever device.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "stgs/format/math/lang.h"
#include "stgs/format/rans_layout.h"

namespace stgs {

// In file order (spec 6.3). From kOptionalAttributes on, readers skip what they do not know.
enum class Attribute : std::uint16_t {
  kPosition = 1,
  kTime,
  kSigma,
  kRadius,
  kVelocity,
  kLogScale,
  kRotation,
  kOpacity,
  kSh0,
  kSh1,
  kSh2,
  kSh3,
};
inline constexpr std::uint16_t kOptionalAttributes = 0x8000;

// What an integer q means, in steps of multiplier 2^exponent (spec 7.5). A new meaning is a new
// number.
enum class Mapping : std::uint8_t {
  kFloat = 0,           // the bits of a float32
  kLinear = 1,          // origin[c mod 3] + step q
  kTruncated = 2,       // as_float(bits(origin[0]) + step q) - origin[1]
  kDisplacement = 3,    // step q / 2^(log2 of the lifespan)
  kRotation = 4,        // vector part of a unit quaternion in steps
  kColour = 5,          // the channels of luma and two chroma integers, in steps
  kShapedRotation = 6,  // kRotation, finer the longer the primitive is against its width
  kTime = 7,            // kLinear, from the beginning of the segment on
};
// How q follows from the values v of the planes (spec 7.4).
enum class Prediction : std::uint8_t {
  kPlain = 0,   // q = v
  kZigzag = 1,  // q = unzigzag(v)
  kDelta = 2,   // q = previous q + unzigzag(v)
  kMorton = 3,  // running sum of v from the record's first key, its bits dealt to three q
};

inline constexpr std::size_t kMaxDigits = 16;
// Exponents of steps (spec 7.5): between these no result is subnormal or infinite, and every
// product is exact, so that decoders that flush the ones or fuse the others give the same bits.
inline constexpr int kMinExponent = -100, kMaxExponent = 100;
// Of a rotation's step.
inline constexpr int kMinRotationExponent = -14, kMaxRotationExponent = -1;
// Of the lifespan that scales a displacement (spec 7.5.4).
inline constexpr int kMinLifespanExponent = -32, kMaxLifespanExponent = 32;
// Of the floats that kTruncated makes, bits of the greatest: 2^100.
inline constexpr std::uint32_t kMaxTruncated = 0x71800000;

// A step of integers, multiplier 2^exponent.
struct Step {
  int exponent = 0;
  int multiplier = 1;  // 1 to 255, odd
  bool operator==(const Step&) const = default;
};

// The greatest |q| of a mapping with this multiplier: products below 2^24, and of colours below
// 2^22, of which a channel has three.
STGS_FN std::uint32_t max_steps(Mapping mapping, int multiplier) {
  const std::uint32_t most = (1u << (mapping == Mapping::kColour ? 22 : 24)) - 1;
  return most / static_cast<std::uint32_t>(multiplier);
}

// One digit of one component of all primitives of a record.
struct CodedPlane {
  enum class Source : std::uint8_t {
    kConstant,  // `only` for each of them
    kGroup,     // plane `number` of the record's rANS group
    kStored,    // plane `number` of `stored`
  };
  Source source = Source::kConstant;
  std::uint8_t only = 0;
  std::uint32_t number = 0;
};

// An attribute of a record's primitives.
struct CodedStream {
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  Prediction prediction = Prediction::kPlain;
  Step step;
  std::size_t components = 0;                         // of the planes
  std::size_t digits = 0;                             // of a value, lowest first
  std::array<std::uint8_t, kMaxDigits> digit_bits{};  // of each
  std::array<float, 3> origin{};
  std::vector<CodedPlane> planes;  // components x digits
};

struct CodedRecord {
  std::vector<CodedStream> streams;       // in file order
  std::vector<std::uint8_t> bytes;        // of the rANS group; empty: there is none
  std::vector<RansBlockLocation> blocks;  // of the group
  std::vector<std::uint16_t> tables;      // by plane of the group
  bool own_tables = false;                // `tables` are numbers of `lookups`, not the file's
  std::vector<RansLookup> lookups;        // empty unless own_tables
  std::vector<std::uint8_t> stored;       // planes that are not rANS, n symbols each
};

struct CodedSegment {
  std::uint32_t primitives = 0;
  int sh_degree = 0;                 // of the file
  float part_ticks = 0;              // length of its part
  double begin = 0;                  // of the segment, before its part cuts it; ticks of its part
  std::uint64_t first_key = 0;       // of positions with Prediction::kMorton
  std::vector<CodedRecord> records;  // that with the base, then that of the harmonics
};

// Undoes zigzag coding, in which 0, -1, 1, -2 are 0, 1, 2, 3.
STGS_FN std::uint32_t unzigzag(std::uint32_t v) {
  return (v >> 1) ^ (0u - (v & 1u));
}

// Every third bit of a key, from the lowest on: 21 bits.
STGS_FN std::uint32_t compact3(std::uint64_t v) {
  v &= 0x1249249249249249;
  v = (v | v >> 2) & 0x10C30C30C30C30C3;
  v = (v | v >> 4) & 0x100F00F00F00F00F;
  v = (v | v >> 8) & 0x1F0000FF0000FF;
  v = (v | v >> 16) & 0x1F00000000FFFF;
  v = (v | v >> 32) & 0x1FFFFF;
  return static_cast<std::uint32_t>(v);
}

// The integer that the moments of a segment from `begin` on count from (spec 7.5.8).
std::int64_t time_origin(double begin, Step step);

}  // namespace stgs
