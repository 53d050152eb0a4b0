// SPDX-License-Identifier: Apache-2.0
// Decoding a block's plane on the vector unit. A step of 32 lanes takes one or more vectors; the
// states stay in registers throughout the plane.
#include <algorithm>
#include <cstring>

#include "codec/rans_block.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "codec/rans_vector.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace stgs::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using States = hn::CappedTag<std::uint32_t, 16>;
using StateVec = hn::Vec<States>;
using StateMask = hn::Mask<States>;
constexpr std::size_t kVectorLanes = hn::MaxLanes(States());
constexpr std::size_t kVectors = kRansLanes / kVectorLanes;
constexpr std::size_t kStepBytes = 2 * kRansLanes;  // of words per step, at most

// Row m: for each lane, the number of lower lanes in the bit mask m.
struct Ranks {
  HWY_ALIGN std::uint8_t row[256][8];
};
constexpr Ranks kRanks = [] {
  Ranks ranks{};
  for (unsigned mask = 0; mask < 256; ++mask) {
    std::uint8_t rank = 0;
    for (unsigned lane = 0; lane < 8; ++lane) {
      ranks.row[mask][lane] = rank;
      rank = static_cast<std::uint8_t>(rank + (mask >> lane & 1));
    }
  }
  return ranks;
}();

// Distributes the next words to the lanes of the mask, in order. Other lanes are unspecified.
HWY_INLINE StateVec deal_words(const std::uint8_t* next, StateMask mask) {
  const States d;
  const hn::Rebind<std::uint16_t, States> dw;
  HWY_ALIGN std::uint16_t words[kVectorLanes];
  std::memcpy(words, next, sizeof words);  // a single unaligned load
  const StateVec loaded = hn::PromoteTo(d, hn::Load(dw, words));
#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86
  return StateVec{_mm512_maskz_expand_epi32(mask.raw, loaded.raw)};
#else
  if constexpr (kVectorLanes == 1) {
    return loaded;
  } else {
    static_assert(kVectorLanes <= 8);
    const hn::Rebind<std::uint8_t, States> db;
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(d, mask, bits);
    const StateVec ranks = hn::PromoteTo(d, hn::LoadU(db, kRanks.row[bits[0]]));
    return hn::TableLookupLanes(loaded, hn::IndicesFromVec(d, ranks));
  }
#endif
}

// Decodes a symbol of each lane of x and returns the next word. The first `lanes` lanes take words;
// in a full block all of them do.
template <bool kFull>
HWY_INLINE const std::uint8_t* step(StateVec& x, std::size_t lanes, const std::uint32_t* lookup,
                                    const std::uint8_t* next, std::uint8_t* out) {
  const States d;
  const hn::RebindToSigned<States> di;
  const hn::Rebind<std::uint8_t, States> db;
  const StateVec low = hn::Set(d, kRansTotal - 1);
  const StateVec entry = hn::GatherIndex(d, lookup, hn::BitCast(di, hn::And(x, low)));
  hn::StoreU(hn::DemoteTo(db, hn::BitCast(di, hn::ShiftRight<24>(entry))), db, out);
  const StateVec quotient = hn::ShiftRight<kRansBits>(x);
  const StateVec less = hn::And(hn::ShiftRight<kRansBits>(entry), low);
  const StateVec y = hn::Add(hn::Mul(quotient, less), hn::Add(quotient, hn::And(entry, low)));
  StateMask refill = hn::Eq(hn::ShiftRight<16>(y), hn::Zero(d));
  if constexpr (!kFull) refill = hn::And(refill, hn::FirstN(d, lanes));
  const StateVec refilled = hn::Or(hn::ShiftLeft<16>(y), deal_words(next, refill));
  x = hn::IfThenElse(refill, refilled, y);
  return next + 2 * hn::CountTrue(d, refill);
}

// Makes 64 bytes readable at block.next.
void move_to_tail(RansBlock& block) {
  const auto left = static_cast<std::size_t>(block.end - block.next);
  std::memcpy(block.tail, block.next, left);
  block.next = block.tail;
  block.end = block.tail + left;
  block.moved = true;
}

// Decodes complete steps of blocks of equal length until fewer symbols are left than one store
// writes. Returns the number decoded. Bytes stored past a step's last lane are overwritten by the
// next step.
template <bool kFull, std::size_t kBlocks>
HWY_INLINE std::size_t decode_steps(RansBlock* const (&blocks)[kBlocks], const RansLookup& lookup,
                                    std::size_t count, std::uint8_t* const (&out)[kBlocks]) {
  const States d;
  const std::size_t lanes = kFull ? kRansLanes : blocks[0]->lanes;
  const std::size_t vectors = kFull ? kVectors : (lanes + kVectorLanes - 1) / kVectorLanes;
  StateVec x[kBlocks][kVectors];
  const std::uint8_t* next[kBlocks];
  // Last word at which a step may begin: 64 bytes must be readable, and no word may be missing.
  const std::uint8_t* last[kBlocks];
  for (std::size_t k = 0; k < kBlocks; ++k) {
    for (std::size_t v = 0; v < kVectors; ++v)
      x[k][v] = hn::LoadU(d, blocks[k]->state + v * kVectorLanes);
  }
  const auto in_reach = [&] {
    bool all = true;
    for (std::size_t k = 0; k < kBlocks; ++k) all = all && next[k] <= last[k];
    return all;
  };
  std::size_t i = 0;
  while (i + vectors * kVectorLanes <= count) {
    for (std::size_t k = 0; k < kBlocks; ++k) {
      RansBlock& block = *blocks[k];
      if (!block.moved && static_cast<std::size_t>(block.end - block.next) < kStepBytes)
        move_to_tail(block);
      next[k] = block.next;
      last[k] = block.moved ? block.end : block.end - kStepBytes;
    }
    for (; i + vectors * kVectorLanes <= count && in_reach(); i += lanes) {
      for (std::size_t v = 0; v < vectors; ++v) {
        for (std::size_t k = 0; k < kBlocks; ++k) {
          next[k] = step<kFull>(x[k][v], lanes - v * kVectorLanes, lookup.data(), next[k],
                                out[k] + i + v * kVectorLanes);
        }
      }
    }
    for (std::size_t k = 0; k < kBlocks; ++k) {
      RansBlock& block = *blocks[k];
      block.overrun = block.overrun || next[k] > block.end;  // words past the end were 0
      block.next = std::min(next[k], block.end);
    }
  }
  for (std::size_t k = 0; k < kBlocks; ++k) {
    for (std::size_t v = 0; v < kVectors; ++v)
      hn::StoreU(x[k][v], d, blocks[k]->state + v * kVectorLanes);
  }
  return i;
}

void decode_plane(RansBlock& block, const RansLookup& lookup, std::size_t count,
                  std::uint8_t* out) {
  RansBlock* const blocks[1] = {&block};
  std::uint8_t* const outs[1] = {out};
  const std::size_t done = block.lanes == kRansLanes
                               ? decode_steps<true>(blocks, lookup, count, outs)
                               : decode_steps<false>(blocks, lookup, count, outs);
  rans_decode_scalar(block, lookup, done, count, out);
}

// Decodes two full blocks in an interleaved way, which hides the latency of table lookups.
void decode_pair(RansBlock& first, RansBlock& second, const RansLookup& lookup, std::uint8_t* out) {
  if constexpr (kVectors <= 4) {  // the states of both fit into registers
    RansBlock* const blocks[2] = {&first, &second};
    std::uint8_t* const outs[2] = {out, out + kRansBlock};
    decode_steps<true>(blocks, lookup, kRansBlock, outs);
  } else {
    decode_plane(first, lookup, kRansBlock, out);
    decode_plane(second, lookup, kRansBlock, out + kRansBlock);
  }
}

const char* vector_name() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace
}  // namespace stgs::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs {

HWY_EXPORT(decode_plane);
HWY_EXPORT(decode_pair);
HWY_EXPORT(vector_name);

void rans_decode_vector(RansBlock& block, const RansLookup& lookup, std::size_t count,
                        std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(decode_plane)(block, lookup, count, out);
}

void rans_decode_pair(RansBlock& first, RansBlock& second, const RansLookup& lookup,
                      std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(decode_pair)(first, second, lookup, out);
}

const char* rans_vector_target() {
  return HWY_DYNAMIC_DISPATCH(vector_name)();
}

}  // namespace stgs
#endif
