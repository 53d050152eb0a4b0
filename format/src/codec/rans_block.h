// SPDX-License-Identifier: Apache-2.0
// Decoding state of a block of a rANS group, shared by the scalar and the vector decoder.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "codec/rans.h"

namespace stgs {

struct RansBlock {
  std::uint32_t state[kRansLanes] = {};
  const std::uint8_t* next = nullptr;  // next word; little-endian, unaligned
  const std::uint8_t* end = nullptr;   // of the words
  std::size_t lanes = 0;
  bool overrun = false;  // a word past the end was requested; it reads as 0
  bool moved = false;    // next and end point into `tail`
  // The last words, fewer than 32, then zeros: the vector unit loads more words than it consumes.
  std::uint8_t tail[2 * 2 * kRansLanes] = {};
};

// Decodes one symbol of a lane.
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

// Decodes the symbols [begin, end) of a block, as far as it has words for all
// lanes, and returns where it stopped, after a multiple of the lanes. Whether a lane takes a word
// cannot be predicted, so it is computed without a comparison, which compilers may turn into a
// branch.
inline std::size_t rans_decode_full(RansBlock& block, const RansLookup& lookup, std::size_t begin,
                                    std::size_t end, std::uint8_t* out) {
  const std::size_t lanes = block.lanes;
  std::uint32_t states[kRansLanes];  // a copy, which the symbols cannot alias
  std::copy_n(block.state, lanes, states);
  const std::uint8_t* next = block.next;
  std::size_t first = begin;
  while (end - first >= lanes && static_cast<std::size_t>(block.end - next) >= 2 * lanes) {
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      const std::uint32_t entry = lookup[states[lane] % kRansTotal];
      const std::uint32_t frequency = (entry >> kRansBits) % kRansTotal + 1;
      const std::uint32_t x = frequency * (states[lane] >> kRansBits) + entry % kRansTotal;
      const std::uint32_t word = next[0] | static_cast<std::uint32_t>(next[1]) << 8;
      static_assert(kRansLow == 1 << 16);
      const std::uint32_t takes = 0 - (((x >> 16) - 1) >> 31);  // all bits if x < kRansLow, else 0
      states[lane] = (x << (takes & 16)) | (word & takes);
      next += takes & 2;
      out[first + lane] = static_cast<std::uint8_t>(entry >> 24);
    }
    first += lanes;
  }
  std::copy_n(states, lanes, block.state);
  block.next = next;
  return first;
}

// Decodes symbols [begin, count) of a block's plane; `begin` is a multiple of its lanes. Lanes are
// independent and take words in their order, so they can be processed one after the other.
inline void rans_decode_rest(RansBlock& block, const RansLookup& lookup, std::size_t begin,
                             std::size_t count, std::uint8_t* out) {
  begin = rans_decode_full(block, lookup, begin, count, out);
  for (std::size_t first = begin; first < count; first += block.lanes) {
    const std::size_t active = count - first < block.lanes ? count - first : block.lanes;
    for (std::size_t lane = 0; lane < active; ++lane)
      out[first + lane] = rans_step(block, block.state[lane], lookup);
  }
}

// As above from begin = 0.
inline void rans_decode_scalar(RansBlock& block, const RansLookup& lookup, std::size_t count,
                               std::uint8_t* out) {
  rans_decode_rest(block, lookup, 0, count, out);
}

// The same on the vector unit.
void rans_decode_vector(RansBlock& block, const RansLookup& lookup, std::size_t count,
                        std::uint8_t* out);

// The planes of a group that remain to be decoded in one of its blocks.
struct RansCursor {
  RansBlock* block = nullptr;
  const RansPlaneTask* next = nullptr;
  const RansPlaneTask* end = nullptr;
  std::size_t count = 0;  // symbols of a plane
};
// Decodes all planes of a block, whose symbols start at `first` of each plane, by calls of
// `decode` with the arguments of rans_decode_vector().
template <typename Decode>
void rans_decode_planes(RansCursor& cursor, std::size_t first, const Decode& decode) {
  RansLookup own;
  for (; cursor.next != cursor.end; ++cursor.next) {
    const RansPlaneTask& plane = *cursor.next;
    if (plane.lookup == nullptr) rans_lookup(*plane.table, own);
    decode(*cursor.block, plane.lookup != nullptr ? *plane.lookup : own, cursor.count,
           plane.out + first);
  }
}
// Decodes all planes of these blocks, whose symbols start at `first` of each plane. Changes
// `cursors`.
void rans_decode_blocks(std::span<RansCursor> cursors, std::size_t first);

}  // namespace stgs
