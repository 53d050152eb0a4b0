// SPDX-License-Identifier: Apache-2.0
// A block of a rANS group while it is decoded, shared by the scalar and the vector decoder.
#pragma once

#include <cstddef>
#include <cstdint>

#include "rans.h"

namespace stgs {

struct RansBlock {
  std::uint32_t state[kRansLanes] = {};
  const std::uint8_t* next = nullptr;  // word to be read; little-endian, of any alignment
  const std::uint8_t* end = nullptr;   // of the words
  std::size_t lanes = 0;
  bool overrun = false;  // a word was wanted past the end; it counted as 0
  bool moved = false;    // next and end point into `tail`
  // The last words, for a vector unit that loads more than it takes: fewer than 32, then zeros.
  std::uint8_t tail[2 * 2 * kRansLanes] = {};
};

// One symbol of a lane.
inline std::uint8_t rans_step(RansBlock& block, std::uint32_t& state, const RansLookup& lookup) {
  const std::uint32_t entry = lookup[state % kRansTotal];
  const std::uint32_t frequency = (entry >> kRansBits) % kRansTotal + 1;
  std::uint32_t x = frequency * (state >> kRansBits) + entry % kRansTotal;
  if (x < kRansLow) {
    std::uint32_t word = 0;
    if (block.next != block.end) {
      word = block.next[0] | static_cast<std::uint32_t>(block.next[1]) << 8;
      block.next += 2;
    } else {
      block.overrun = true;
    }
    x = x << 16 | word;
  }
  state = x;
  return static_cast<std::uint8_t>(entry >> 24);
}

// Symbols [begin, count) of a block's plane; begin is a multiple of its lanes. Lanes of a step do
// not depend on each other and take words in their order, so one after the other will do.
inline void rans_decode_scalar(RansBlock& block, const RansLookup& lookup, std::size_t begin,
                               std::size_t count, std::uint8_t* out) {
  for (std::size_t first = begin; first < count; first += block.lanes) {
    const std::size_t active = count - first < block.lanes ? count - first : block.lanes;
    for (std::size_t lane = 0; lane < active; ++lane)
      out[first + lane] = rans_step(block, block.state[lane], lookup);
  }
}

// The same from begin = 0, on the machine's vector unit.
void rans_decode_vector(RansBlock& block, const RansLookup& lookup, std::size_t count,
                        std::uint8_t* out);
// Two whole blocks that follow each other, which is faster than one after the other.
void rans_decode_pair(RansBlock& first, RansBlock& second, const RansLookup& lookup,
                      std::uint8_t* out);

}  // namespace stgs
