// SPDX-License-Identifier: Apache-2.0
// One attribute of one segment as bytes: mapping to integers, prediction, planes of digits, entropy
// coder (spec 7).
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "attributes.h"
#include "findings.h"

namespace stgs {

// What an integer q means (spec 7.5). A new meaning is a new number.
enum class Mapping : std::uint8_t {
  kFloat = 0,           // the bits of a float32
  kLinear = 1,          // origin[c mod 3] + 2^exponent q
  kTruncated = 2,       // as_float(bits(origin[0]) + q 2^exponent) - origin[1]
  kDisplacement = 3,    // 2^(exponent - log2 of the lifespan) q
  kRotation = 4,        // vector part of a unit quaternion in units of 2^exponent
  kColour = 5,          // 2^exponent times the channels of luma and two chroma integers
  kShapedRotation = 6,  // kRotation, finer the longer the primitive is against its width
};
// How q follows from the values v of the planes (spec 7.4).
enum class Prediction : std::uint8_t {
  kPlain = 0,   // q = v
  kZigzag = 1,  // q = unzigzag(v)
  kDelta = 2,   // q = previous q + unzigzag(v)
  kMorton = 3,  // running sum of v, its bits dealt to three q
};
enum class Coder : std::uint8_t { kStored = 0, kZstd = 1 };

inline constexpr std::size_t kStreamEntryBytes = 37;
inline constexpr int kMortonBits = 21;  // an axis
// Exponents of a rotation's step.
inline constexpr int kFinestRotation = -12, kCoarsestRotation = -1;
inline constexpr std::int64_t kMaxInteger = std::int64_t{1}
                                            << 24;  // |q| below it is exact in float32

// A row of a segment's stream table (spec 6.2).
struct StreamEntry {
  std::uint16_t attribute = 0;
  std::uint8_t components = 0;  // of the planes
  std::uint8_t mapping = 0, prediction = 0, coder = 0;
  std::uint8_t digit_bits = 8, digits = 0;  // of a value; 8 / digit_bits neighbours share a byte
  std::int8_t exponent = 0;
  std::uint64_t bytes = 0;     // stored
  std::uint64_t checksum = 0;  // of the decoded planes
  float origin[3] = {0, 0, 0};
};

// An attribute as integers, before prediction.
struct Integers {
  Attribute attribute = Attribute::kPosition;
  Mapping mapping = Mapping::kFloat;
  int exponent = 0;
  float origin[3] = {0, 0, 0};
  int components = 0;
  std::vector<std::uint32_t> values;  // one component after the other, two's complement
  std::vector<std::uint64_t> morton;  // instead of values: ascending keys
};

struct EncodedStream {
  StreamEntry entry;
  std::vector<std::uint8_t> bytes;
};
EncodedStream encode_stream(const Integers& integers, int zstd_level);

// Where a message says it happened.
struct StreamPlace {
  std::uint32_t segment = 0;
  std::uint64_t offset = 0;  // of the stream's bytes, or its table row
};
// Bytes of a plane: one digit of n values.
constexpr std::uint64_t plane_bytes(std::uint64_t n, int digit_bits) {
  return (n * static_cast<std::uint64_t>(digit_bits) + 7) / 8;
}
// Checks a row against what this version knows.
bool check_entry(const StreamEntry& entry, StreamPlace place, Findings& findings);
// Compares the size that the stored bytes state with that of the planes (spec 7.2); allocates
// nothing.
bool check_size(const StreamEntry& entry, std::span<const std::uint8_t> stored,
                std::uint64_t primitives, StreamPlace place, Findings& findings);
// Entropy-decodes to components x digits planes and checks them. check_size must have passed.
bool decode_planes(const StreamEntry& entry, std::span<const std::uint8_t> stored,
                   std::uint64_t primitives, StreamPlace place, std::vector<std::uint8_t>& planes,
                   Findings& findings);
// From planes to floats in `set`, whose arrays have their size. Velocity needs sigma and radius.
bool map_planes(const StreamEntry& entry, std::span<const std::uint8_t> planes,
                std::uint32_t frames, StreamPlace place, Gaussians4D& set, Findings& findings);

// What a primitive of these log-scales adds to the exponent of its rotation (spec 7.5.7): a turn of
// what is nearly round is hard to see.
int rotation_shift(const float* log_scale);
// floor(log2) of the lifespan that scales a displacement (spec 7.5.4).
int lifespan_exponent(float sigma, float radius, std::uint32_t frames);

constexpr std::uint32_t zigzag(std::int32_t q) {
  return (static_cast<std::uint32_t>(q) << 1) ^ static_cast<std::uint32_t>(q >> 31);
}
constexpr std::uint32_t unzigzag(std::uint32_t v) {
  return (v >> 1) ^ (0u - (v & 1u));
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
constexpr std::uint32_t compact3(std::uint64_t v) {
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
