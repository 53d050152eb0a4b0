// SPDX-License-Identifier: Apache-2.0
// Decodes planes on the vector unit. A step takes vectors as wide as the block has lanes: a narrow
// table lookup is faster than a wide one. The states stay in registers throughout a plane.
#include <algorithm>
#include <cstring>
#include <type_traits>
#include <utility>

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

// Vectors of the states of blocks with up to this many lanes.
template <std::size_t kLanes>
using StatesOf = hn::CappedTag<std::uint32_t, std::min<std::size_t>(kLanes, 16)>;
constexpr std::size_t kMinLanes = 4;  // of a vector, if the target has as many
constexpr std::size_t kCacheLine = 64;
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
template <typename D>
HWY_INLINE hn::Vec<D> deal_words(D d, const std::uint8_t* next, hn::Mask<D> mask) {
  const hn::Rebind<std::uint16_t, D> dw;
  HWY_ALIGN std::uint16_t words[hn::MaxLanes(d)];
  std::memcpy(words, next, sizeof words);  // a single unaligned load
  const hn::Vec<D> loaded = hn::PromoteTo(d, hn::Load(dw, words));
#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86
  if constexpr (hn::MaxLanes(d) == 16) {
    return hn::Vec<D>{_mm512_maskz_expand_epi32(mask.raw, loaded.raw)};
  } else if constexpr (hn::MaxLanes(d) == 8) {
    return hn::Vec<D>{_mm256_maskz_expand_epi32(mask.raw, loaded.raw)};
  } else {
    return hn::Vec<D>{_mm_maskz_expand_epi32(mask.raw, loaded.raw)};
  }
#else
  if constexpr (hn::MaxLanes(d) == 1) {
    return loaded;
  } else {
    static_assert(hn::MaxLanes(d) <= 8);
    const hn::Rebind<std::uint8_t, D> db;
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(d, mask, bits);
    const hn::Vec<D> ranks = hn::PromoteTo(d, hn::LoadU(db, kRanks.row[bits[0]]));
    return hn::TableLookupLanes(loaded, hn::IndicesFromVec(d, ranks));
  }
#endif
}

// Returns the entries of these slots.
template <typename D>
HWY_INLINE hn::Vec<D> look_up(D d, const std::uint32_t* lookup, hn::Vec<D> slots) {
#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86
  if constexpr (hn::MaxLanes(d) == 16) {
    // Two gathers of 8 lanes overlap with other instructions better than one of 16.
    const auto* const from = reinterpret_cast<const int*>(lookup);
    const __m256i low = _mm256_i32gather_epi32(from, _mm512_castsi512_si256(slots.raw), 4);
    const __m256i high = _mm256_i32gather_epi32(from, _mm512_extracti64x4_epi64(slots.raw, 1), 4);
    return hn::Vec<D>{_mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1)};
  }
#endif
  return hn::GatherIndex(d, lookup, hn::BitCast(hn::RebindToSigned<D>(), slots));
}

// Decodes a symbol of each lane of x and returns the next word. Only lanes of `active` take words;
// kAll: all of them do.
template <bool kAll, typename D>
HWY_INLINE const std::uint8_t* step(D d, hn::Vec<D>& x, hn::Mask<D> active,
                                    const std::uint32_t* lookup, const std::uint8_t* next,
                                    std::uint8_t* out) {
  const hn::Rebind<std::uint8_t, D> db;
  const auto low = hn::Set(d, kRansTotal - 1);
  const auto entry = look_up(d, lookup, hn::And(x, low));
  hn::StoreU(hn::TruncateTo(db, hn::ShiftRight<24>(entry)), db, out);
  const auto quotient = hn::ShiftRight<kRansBits>(x);
  const auto less = hn::And(hn::ShiftRight<kRansBits>(entry), low);
  const auto y = hn::Add(hn::Mul(quotient, less), hn::Add(quotient, hn::And(entry, low)));
  hn::Mask<D> refill = hn::Eq(hn::ShiftRight<16>(y), hn::Zero(d));
  if constexpr (!kAll) refill = hn::And(refill, active);
  const auto refilled = hn::Or(hn::ShiftLeft<16>(y), deal_words(d, next, refill));
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
  // Lookup of the block's next plane, or of this one.
  const std::uint32_t* following = nullptr;
};

// Returns the lanes of the vectors that decode a block: as many as it has, or kMinLanes.
std::size_t width_of(const RansBlock& block) {
  return std::max(block.lanes, kMinLanes);
}

// Complete steps of a plane whose block has kLanes lanes, or up to kLanes if that is kMinLanes.
// The states stay in registers.
template <std::size_t kLanes>
class Steps {
 public:
  using D = StatesOf<kLanes>;
  static constexpr std::size_t kVectorLanes = hn::MaxLanes(D()), kVectors = kLanes / kVectorLanes;
  using Vectors = std::make_index_sequence<kVectors>;

  HWY_INLINE explicit Steps(PlaneOfBlock& plane)
      : plane_(&plane),
        lookup_(plane.lookup),
        following_(plane.following),
        out_(plane.out + plane.done) {
    lanes_ = kLanes == kMinLanes ? plane.block->lanes : kLanes;
    for (std::size_t v = 0; v < kVectors; ++v)
      x_[v] = hn::LoadU(D(), plane.block->state + v * kVectorLanes);
  }
  // Returns the steps before the first that would store past the plane's end.
  HWY_INLINE std::size_t steps() const {
    const std::size_t left = plane_->count - static_cast<std::size_t>(out_ - plane_->out);
    return left < kLanes ? 0 : (left - kLanes) / lanes_ + 1;
  }
  // Begins a run of steps, which lasts while has_words().
  HWY_INLINE void begin() {
    RansBlock& block = *plane_->block;
    if (!block.moved && static_cast<std::size_t>(block.end - block.next) < kStepBytes)
      move_to_tail(block);
    next_ = block.next;
    last_ = block.moved ? block.end : block.end - kStepBytes;
  }
  // Returns whether the bytes of a step are readable.
  HWY_INLINE bool has_words() const { return next_ <= last_; }
  HWY_INLINE void take() {
    take_vectors(Vectors());
    out_ += lanes_;
    prefetch();
  }
  HWY_INLINE void end() {
    RansBlock& block = *plane_->block;
    block.overrun = block.overrun || next_ > block.end;  // words past the end were 0
    block.next = std::min(next_, block.end);
  }
  HWY_INLINE void save() {
    for (std::size_t v = 0; v < kVectors; ++v)
      hn::StoreU(x_[v], D(), plane_->block->state + v * kVectorLanes);
    plane_->done = static_cast<std::size_t>(out_ - plane_->out);
  }

 private:
  // Fetches a part of the next lookup. Most planes have more than 128 steps, enough for all of it.
  HWY_INLINE void prefetch() {
    const auto* const bytes = reinterpret_cast<const std::uint8_t*>(following_) + fetched_;
    __builtin_prefetch(bytes);
    __builtin_prefetch(bytes + kCacheLine);
    fetched_ = (fetched_ + 2 * kCacheLine) % sizeof(RansLookup);
  }
  template <std::size_t... v>
  HWY_INLINE void take_vectors(std::index_sequence<v...>) {
    (take_vector<v>(), ...);
  }
  template <std::size_t v>
  HWY_INLINE void take_vector() {
    // A block of fewer lanes fits one vector, unless vectors have a single lane.
    const std::size_t active = lanes_ - std::min(lanes_, v * kVectorLanes);
    next_ = step<kLanes != kMinLanes>(D(), x_[v], hn::FirstN(D(), active), lookup_, next_,
                                      out_ + v * kVectorLanes);
  }

  PlaneOfBlock* plane_;
  const std::uint32_t *lookup_, *following_;
  std::size_t fetched_ = 0;  // bytes of the next lookup
  const std::uint8_t *next_ = nullptr, *last_ = nullptr;
  std::uint8_t* out_;
  std::size_t lanes_;
  hn::Vec<D> x_[kVectors];
};

// Decodes complete steps of all these planes until one of them has fewer symbols left than a step
// stores. Bytes stored past a step's last lane are overwritten by the next step. The planes are
// arguments of their own, so that the compiler keeps all of them in registers.
template <typename... Planes>
HWY_INLINE void decode_steps(Planes... planes) {
  std::size_t left = std::min({planes.steps()...});
  while (left > 0) {
    (planes.begin(), ...);
    for (; left > 0 && (planes.has_words() & ...); --left) (planes.take(), ...);
    (planes.end(), ...);
  }
  (planes.save(), ...);
}

// Returns whether a step of the plane's block would store past the plane's end.
bool ends_soon(const PlaneOfBlock& plane) {
  return plane.done + width_of(*plane.block) > plane.count;
}

// Decodes the next `active` symbols of a plane, at most as many as its block has lanes. Stores no
// others.
template <std::size_t kLanes>
void decode_some(PlaneOfBlock& plane, std::size_t active) {
  const StatesOf<kLanes> d;
  constexpr std::size_t kVectorLanes = hn::MaxLanes(d);
  RansBlock& block = *plane.block;
  if (!block.moved && static_cast<std::size_t>(block.end - block.next) < kStepBytes)
    move_to_tail(block);
  const std::uint8_t* next = block.next;
  for (std::size_t first = 0; first < active; first += kVectorLanes) {
    const std::size_t used = std::min(kVectorLanes, active - first);
    const auto mask = hn::FirstN(d, used);
    const auto before = hn::LoadU(d, block.state + first);
    auto x = before;
    std::uint8_t symbols[kVectorLanes];
    next = step<false>(d, x, mask, plane.lookup, next, symbols);
    hn::StoreU(hn::IfThenElse(mask, x, before), d, block.state + first);
    std::memcpy(plane.out + plane.done + first, symbols, used);
  }
  block.overrun = block.overrun || next > block.end;  // words past the end were 0
  block.next = std::min(next, block.end);
  plane.done += active;
}

// Decodes the rest of a plane that ends soon.
template <std::size_t kLanes>
void finish_plane(PlaneOfBlock& plane) {
  while (plane.done < plane.count)
    decode_some<kLanes>(plane, std::min(plane.block->lanes, plane.count - plane.done));
}

// Calls `call` with the lanes of a block, kMinLanes for fewer, as a constant.
template <typename Call>
void with_lanes(const RansBlock& block, const Call& call) {
  switch (width_of(block)) {
    case 32:
      return call(std::integral_constant<std::size_t, 32>());
    case 16:
      return call(std::integral_constant<std::size_t, 16>());
    case 8:
      return call(std::integral_constant<std::size_t, 8>());
    default:
      return call(std::integral_constant<std::size_t, kMinLanes>());
  }
}

void decode_plane(RansBlock& block, const RansLookup& lookup, std::size_t count,
                  std::uint8_t* out) {
  PlaneOfBlock plane{&block, lookup.data(), out, count, 0, lookup.data()};
  with_lanes(block, [&](auto lanes) {
    decode_steps(Steps<lanes>(plane));
    finish_plane<lanes>(plane);
  });
}

// Planes decoded at once. Their lookups hide each other's latency; the states of all must fit into
// registers.
template <std::size_t kLanes>
constexpr std::size_t kTogether = std::clamp<std::size_t>(8 / Steps<kLanes>::kVectors, 1, 4);

// A block with planes to decode, and the one that is being decoded.
struct ActiveBlock {
  RansCursor* cursor = nullptr;
  PlaneOfBlock plane;
};

template <std::size_t kLanes, std::size_t... k>
void decode_active(ActiveBlock* active, std::index_sequence<k...>) {
  decode_steps(Steps<kLanes>(active[k].plane)...);
}

// Decodes the planes of `used` blocks, at most kCount, until one of them ends soon.
template <std::size_t kLanes, std::size_t kCount>
void decode_together(ActiveBlock* active, std::size_t used) {
  if constexpr (kCount > 1) {
    if (used < kCount) return decode_together<kLanes, kCount - 1>(active, used);
  }
  decode_active<kLanes>(active, std::make_index_sequence<kCount>());
}

// Begins the next plane of a block; returns false if there is none.
bool begin_plane(ActiveBlock& active, std::size_t first) {
  RansCursor& cursor = *active.cursor;
  if (cursor.next == cursor.end) return false;
  const RansPlaneTask& task = *cursor.next++;
  const RansLookup* const following = cursor.next == cursor.end ? task.lookup : cursor.next->lookup;
  active.plane = {cursor.block,     task.lookup->data(), task.out + first, cursor.count, 0,
                  following->data()};
  return true;
}

// Finishes the planes that end soon and begins the next ones; returns false after the last.
template <std::size_t kLanes>
bool advance(ActiveBlock& active, std::size_t first) {
  while (ends_soon(active.plane)) {
    finish_plane<kLanes>(active.plane);
    if (!begin_plane(active, first)) return false;
  }
  return true;
}

// Decodes blocks of the same number of lanes.
template <std::size_t kLanes>
void decode_same_lanes(std::span<RansCursor> cursors, std::size_t first) {
  ActiveBlock active[kTogether<kLanes>];
  std::size_t used = 0;
  for (auto waiting = cursors.begin();;) {
    for (; used < kTogether<kLanes> && waiting != cursors.end(); ++waiting) {
      active[used].cursor = &*waiting;
      if (begin_plane(active[used], first) && advance<kLanes>(active[used], first)) ++used;
    }
    if (used == 0) return;
    decode_together<kLanes, kTogether<kLanes>>(active, used);
    for (std::size_t k = 0; k < used;) {
      if (advance<kLanes>(active[k], first)) {
        ++k;
      } else {
        active[k] = active[--used];
      }
    }
  }
}

void decode_blocks(std::span<RansCursor> cursors, std::size_t first) {
  while (!cursors.empty()) {
    const std::size_t lanes = width_of(*cursors.front().block);
    const auto others = std::stable_partition(
        cursors.begin(), cursors.end(),
        [&](const RansCursor& cursor) { return width_of(*cursor.block) == lanes; });
    const auto same = static_cast<std::size_t>(others - cursors.begin());
    with_lanes(*cursors.front().block,
               [&](auto constant) { decode_same_lanes<constant>(cursors.first(same), first); });
    cursors = cursors.subspan(same);
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
  for (RansCursor& one : cursors)
    if (one.block->lanes < kRansVectorLanes) rans_decode_planes(one, first, rans_decode_scalar);
  HWY_DYNAMIC_DISPATCH(decode_blocks)(cursors, first);
}

const char* rans_vector_target() {
  return HWY_DYNAMIC_DISPATCH(vector_name)();
}

}  // namespace stgs
#endif
