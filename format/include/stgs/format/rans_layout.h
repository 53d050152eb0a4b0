// SPDX-License-Identifier: Apache-2.0
// The shape of a group of rANS-coded planes (spec annex A): what decoders on all devices share.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stgs {

template <typename T>
class Result;  // stgs/format/status.h, which nvcc cannot compile

inline constexpr int kRansBits = 12;                   // of a frequency
inline constexpr std::uint32_t kRansTotal = 1u << 12;  // sum of a table's frequencies
inline constexpr std::uint32_t kRansLow = 1u << 16;    // least state; a coded word has 16 bits
inline constexpr std::size_t kRansLanes = 32;          // of a block, at most
inline constexpr std::size_t kRansBlock = 2048;        // primitives of a block
inline constexpr std::size_t kRansPlanes = 256;        // of a group, at most
inline constexpr std::size_t kRansLaneSymbols = 64;    // of a lane in a plane, at most

constexpr std::size_t rans_blocks(std::size_t n) {
  return n / kRansBlock + (n % kRansBlock != 0);
}
// Lanes of a block of `count` primitives: a short block has fewer, for each stores a state.
constexpr std::size_t rans_lanes(std::size_t count) {
  return (count + kRansLaneSymbols - 1) / kRansLaneSymbols;
}

// For each slot: slot - start in bits 0 to 11, frequency - 1 in 12 to 23, symbol in 24 to 31.
using RansLookup = std::array<std::uint32_t, kRansTotal>;

// Where a block lies in its group's bytes.
struct RansBlockLocation {
  std::uint64_t states = 0;  // offset of its first state
  std::uint32_t words = 0;   // that follow its states
};

// Finds the blocks of a group of n primitives. After it, nothing that a decoder reads lies outside
// of `bytes`, and all states are possible ones (spec A.4); an error (kInvalidFile) otherwise.
// Allocates no more than twice the size of `bytes`.
Result<std::vector<RansBlockLocation>> rans_layout(std::span<const std::uint8_t> bytes,
                                                   std::size_t n);

}  // namespace stgs
