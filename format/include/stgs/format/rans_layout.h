// SPDX-License-Identifier: Apache-2.0
// The layout of a group of rANS-coded planes (spec 7), shared by decoders on all devices.
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
inline constexpr std::uint32_t kRansLow = 1u << 16;    // lowest state; a coded word has 16 bits
inline constexpr std::size_t kRansLanes = 32;          // per block, at most
inline constexpr std::size_t kRansBlock = 8192;        // symbols of a plane per block
inline constexpr std::size_t kRansPlanes = 256;        // per group, at most
inline constexpr std::size_t kRansLaneSymbols = 256;   // per lane and plane, at most

// Returns the number of blocks of planes of n symbols.
constexpr std::size_t rans_blocks(std::size_t n) {
  return n / kRansBlock + (n % kRansBlock != 0);
}
// Returns the number of lanes of a block of `count` symbols, a power of two. A short block has
// fewer, because each lane stores a state.
constexpr std::size_t rans_lanes(std::size_t count) {
  std::size_t lanes = 1;
  while (lanes * kRansLaneSymbols < count) lanes *= 2;
  return lanes;
}

// A decoding table. Each slot: slot - start in bits 0 to 11, frequency - 1 in 12 to 23, symbol in
// 24 to 31.
using RansLookup = std::array<std::uint32_t, kRansTotal>;

// The location of a block in the bytes of its group.
struct RansBlockLocation {
  std::uint64_t states = 0;  // offset of its first state
  std::uint32_t words = 0;   // number of words after the states
};

// Locates the blocks of a group of planes of n symbols. On success, decoders read within `bytes`
// only and all states are valid (spec 7.3); otherwise kInvalidFile. Allocates at most twice the
// size of `bytes`.
Result<std::vector<RansBlockLocation>> rans_layout(std::span<const std::uint8_t> bytes,
                                                   std::size_t n);

}  // namespace stgs
