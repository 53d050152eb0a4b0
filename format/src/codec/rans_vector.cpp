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

// A plane of a block to decode.
struct PlaneOfBlock {
  RansBlock* block = nullptr;
  const std::uint32_t* lookup = nullptr;
  std::uint8_t* out = nullptr;
  std::size_t count = 0;  // symbols
  std::size_t done = 0;   // symbols decoded
};

// Decodes complete steps of all these planes until one of them has fewer symbols left than one
// store writes. kFull: all blocks have 32 lanes. Bytes stored past a step's last lane are
// overwritten by the next step.
template <bool kFull, std::size_t kCount>
HWY_INLINE void decode_steps(PlaneOfBlock* const (&planes)[kCount]) {
  const States d;
  StateVec x[kCount][kVectors];
  std::size_t lanes[kCount], vectors[kCount], i[kCount];
  const std::uint8_t* next[kCount];
  // Last word at which a step may begin: 64 bytes must be readable, and no word may be missing.
  const std::uint8_t* last[kCount];
  for (std::size_t k = 0; k < kCount; ++k) {
    lanes[k] = kFull ? kRansLanes : planes[k]->block->lanes;
    vectors[k] = kFull ? kVectors : (lanes[k] + kVectorLanes - 1) / kVectorLanes;
    i[k] = planes[k]->done;
    for (std::size_t v = 0; v < kVectors; ++v)
      x[k][v] = hn::LoadU(d, planes[k]->block->state + v * kVectorLanes);
  }
  // Returns the steps that all planes can take before stores or loads reach too far.
  const auto safe_steps = [&] {
    std::size_t steps = kRansBlock;
    for (std::size_t k = 0; k < kCount; ++k) {
      const std::size_t width = vectors[k] * kVectorLanes, left = planes[k]->count - i[k];
      const std::size_t by_stores = left < width ? 0 : (left - width) / lanes[k] + 1;
      const std::size_t by_loads =
          next[k] > last[k] ? 0 : static_cast<std::size_t>(last[k] - next[k]) / (2 * lanes[k]) + 1;
      steps = std::min({steps, by_stores, by_loads});
    }
    return steps;
  };
  const auto more = [&] {
    bool all = true;
    for (std::size_t k = 0; k < kCount; ++k)
      all = all && i[k] + vectors[k] * kVectorLanes <= planes[k]->count;
    return all;
  };
  while (more()) {
    for (std::size_t k = 0; k < kCount; ++k) {
      RansBlock& block = *planes[k]->block;
      if (!block.moved && static_cast<std::size_t>(block.end - block.next) < kStepBytes)
        move_to_tail(block);
      next[k] = block.next;
      last[k] = block.moved ? block.end : block.end - kStepBytes;
    }
    for (std::size_t steps = safe_steps(); steps > 0; steps = safe_steps()) {
      for (; steps > 0; --steps) {
        for (std::size_t v = 0; v < kVectors; ++v) {
          for (std::size_t k = 0; k < kCount; ++k) {
            if (!kFull && v >= vectors[k]) continue;
            next[k] = step<kFull>(x[k][v], lanes[k] - v * kVectorLanes, planes[k]->lookup, next[k],
                                  planes[k]->out + i[k] + v * kVectorLanes);
          }
        }
        for (std::size_t k = 0; k < kCount; ++k) i[k] += lanes[k];
      }
    }
    for (std::size_t k = 0; k < kCount; ++k) {
      RansBlock& block = *planes[k]->block;
      block.overrun = block.overrun || next[k] > block.end;  // words past the end were 0
      block.next = std::min(next[k], block.end);
    }
  }
  for (std::size_t k = 0; k < kCount; ++k) {
    for (std::size_t v = 0; v < kVectors; ++v)
      hn::StoreU(x[k][v], d, planes[k]->block->state + v * kVectorLanes);
    planes[k]->done = i[k];
  }
}

template <std::size_t kCount>
void decode_planes(PlaneOfBlock* const (&planes)[kCount]) {
  const bool full = std::all_of(std::begin(planes), std::end(planes),
                                [](auto* p) { return p->block->lanes == kRansLanes; });
  full ? decode_steps<true>(planes) : decode_steps<false>(planes);
}

// Returns whether a step of the plane's block would store past the plane's end.
bool ends_soon(const PlaneOfBlock& plane) {
  const std::size_t vectors = (plane.block->lanes + kVectorLanes - 1) / kVectorLanes;
  return plane.done + vectors * kVectorLanes > plane.count;
}

// Decodes the next `active` symbols of a plane, at most as many as its block has lanes. Stores no
// others.
void decode_some(PlaneOfBlock& plane, std::size_t active) {
  const States d;
  RansBlock& block = *plane.block;
  if (!block.moved && static_cast<std::size_t>(block.end - block.next) < kStepBytes)
    move_to_tail(block);
  const std::uint8_t* next = block.next;
  for (std::size_t first = 0; first < active; first += kVectorLanes) {
    const std::size_t used = std::min(kVectorLanes, active - first);
    const StateVec before = hn::LoadU(d, block.state + first);
    StateVec x = before;
    std::uint8_t symbols[kVectorLanes];
    next = step<false>(x, used, plane.lookup, next, symbols);
    hn::StoreU(hn::IfThenElse(hn::FirstN(d, used), x, before), d, block.state + first);
    std::memcpy(plane.out + plane.done + first, symbols, used);
  }
  block.overrun = block.overrun || next > block.end;  // words past the end were 0
  block.next = std::min(next, block.end);
  plane.done += active;
}

// Decodes the rest of a plane that ends soon.
void finish_plane(PlaneOfBlock& plane) {
  while (plane.done < plane.count)
    decode_some(plane, std::min(plane.block->lanes, plane.count - plane.done));
}

void decode_plane(RansBlock& block, const RansLookup& lookup, std::size_t count,
                  std::uint8_t* out) {
  PlaneOfBlock plane{&block, lookup.data(), out, count};
  PlaneOfBlock* const one[1] = {&plane};
  decode_planes(one);
  finish_plane(plane);
}

// Planes decoded at once: the states of all must fit into registers.
constexpr std::size_t kTogether = kVectors <= 2 ? 8 : kVectors <= 4 ? 2 : 1;

// A block with planes to decode, and the one that is being decoded.
struct ActiveBlock {
  RansCursor* cursor = nullptr;
  PlaneOfBlock plane;
};

// Decodes the planes of `used` blocks, at most kCount, until one of them ends soon.
template <std::size_t kCount>
void decode_together(ActiveBlock* active, std::size_t used) {
  if constexpr (kCount > 1) {
    if (used < kCount) return decode_together<kCount - 1>(active, used);
  }
  PlaneOfBlock* planes[kCount];
  for (std::size_t k = 0; k < kCount; ++k) planes[k] = &active[k].plane;
  decode_planes(planes);
}

// Begins the next plane of a block; returns false if there is none.
bool begin_plane(ActiveBlock& active, std::size_t first) {
  RansCursor& cursor = *active.cursor;
  if (cursor.next == cursor.end) return false;
  const RansPlaneTask& task = *cursor.next++;
  active.plane = {cursor.block, task.lookup->data(), task.out + first, cursor.count};
  return true;
}

// Finishes the planes that end soon and begins the next ones; returns false after the last.
bool advance(ActiveBlock& active, std::size_t first) {
  while (ends_soon(active.plane)) {
    finish_plane(active.plane);
    if (!begin_plane(active, first)) return false;
  }
  return true;
}

void decode_blocks(std::span<RansCursor> cursors, std::size_t first) {
  ActiveBlock active[kTogether];
  std::size_t used = 0;
  for (auto waiting = cursors.begin();;) {
    for (; used < kTogether && waiting != cursors.end(); ++waiting) {
      active[used].cursor = &*waiting;
      if (begin_plane(active[used], first) && advance(active[used], first)) ++used;
    }
    if (used == 0) return;
    decode_together<kTogether>(active, used);
    for (std::size_t k = 0; k < used;) {
      if (advance(active[k], first)) {
        ++k;
      } else {
        active[k] = active[--used];
      }
    }
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
HWY_EXPORT(decode_blocks);
HWY_EXPORT(vector_name);

void rans_decode_vector(RansBlock& block, const RansLookup& lookup, std::size_t count,
                        std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(decode_plane)(block, lookup, count, out);
}

void rans_decode_blocks(std::span<RansCursor> cursors, std::size_t first) {
  HWY_DYNAMIC_DISPATCH(decode_blocks)(cursors, first);
}

const char* rans_vector_target() {
  return HWY_DYNAMIC_DISPATCH(vector_name)();
}

}  // namespace stgs
#endif
