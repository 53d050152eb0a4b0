// SPDX-License-Identifier: Apache-2.0
// The functions of codec/rans_vector.cpp for WebAssembly, with vectors of four lanes. WebAssembly
// has no gather instructions, so each lane loads its entry of the lookup table separately.
#include <wasm_simd128.h>

#include <bit>

#include "codec/rans_block.h"

namespace stgs {
namespace {

constexpr std::size_t kVectorLanes = 4;
constexpr std::size_t kMinLanes = 8;  // blocks with fewer lanes decode faster in the scalar loop

// Row m: for each byte of four lanes of 32 bits, the byte of the next words that it takes if the
// lanes of the bit mask m take a word each, in order; other bytes become 0.
struct Deals {
  alignas(16) std::uint8_t row[16][16];
};
constexpr Deals kDeals = [] {
  Deals deals{};
  for (unsigned mask = 0; mask < 16; ++mask) {
    std::uint8_t word = 0;
    for (unsigned byte = 0; byte < 16; ++byte) deals.row[mask][byte] = 0x80;
    for (unsigned lane = 0; lane < kVectorLanes; ++lane) {
      if ((mask >> lane & 1) == 0) continue;
      deals.row[mask][4 * lane] = word++;
      deals.row[mask][4 * lane + 1] = word++;
    }
  }
  return deals;
}();

// Returns the entries at these byte offsets.
v128_t look_up(const RansLookup& lookup, v128_t offsets) {
  const auto* const from = reinterpret_cast<const std::uint8_t*>(lookup.data());
  const auto at = [&](int offset) { return from + offset; };
  v128_t out = wasm_v128_load32_zero(at(wasm_i32x4_extract_lane(offsets, 0)));
  out = wasm_v128_load32_lane(at(wasm_i32x4_extract_lane(offsets, 1)), out, 1);
  out = wasm_v128_load32_lane(at(wasm_i32x4_extract_lane(offsets, 2)), out, 2);
  return wasm_v128_load32_lane(at(wasm_i32x4_extract_lane(offsets, 3)), out, 3);
}

// Decodes a symbol of each of four lanes and returns the next word. 8 bytes of words are readable.
const std::uint8_t* step(std::uint32_t* states, const RansLookup& lookup, const std::uint8_t* next,
                         std::uint8_t* out) {
  static_assert(kRansLow == 1 << 16 && kRansBits == 12);
  const v128_t low = wasm_i32x4_const_splat(kRansTotal - 1);
  const v128_t x = wasm_v128_load(states);
  const v128_t entry = look_up(
      lookup, wasm_v128_and(wasm_i32x4_shl(x, 2), wasm_i32x4_const_splat(4 * (kRansTotal - 1))));
  const v128_t symbols =
      wasm_i8x16_shuffle(entry, entry, 3, 7, 11, 15, 3, 7, 11, 15, 3, 7, 11, 15, 3, 7, 11, 15);
  wasm_v128_store32_lane(out, symbols, 0);
  const v128_t quotient = wasm_u32x4_shr(x, kRansBits);
  const v128_t less = wasm_v128_and(wasm_u32x4_shr(entry, kRansBits), low);
  const v128_t y = wasm_i32x4_add(wasm_i32x4_mul(quotient, less),
                                  wasm_i32x4_add(quotient, wasm_v128_and(entry, low)));
  const v128_t refill = wasm_i32x4_eq(wasm_u32x4_shr(y, 16), wasm_i32x4_const_splat(0));
  const auto mask = static_cast<unsigned>(wasm_i32x4_bitmask(refill));
  const v128_t words =
      wasm_i8x16_swizzle(wasm_v128_load64_zero(next), wasm_v128_load(kDeals.row[mask]));
  const v128_t shifted = wasm_v128_bitselect(wasm_i32x4_shl(y, 16), y, refill);
  wasm_v128_store(states, wasm_v128_or(shifted, words));
  return next + 2 * std::popcount(mask);
}

// As rans_decode_full() from `begin` = 0, for kMinLanes or more.
std::size_t decode_full(RansBlock& block, const RansLookup& lookup, std::size_t end,
                        std::uint8_t* out) {
  const std::size_t lanes = block.lanes;
  std::uint32_t states[kRansLanes];  // a copy, which the symbols cannot alias
  std::copy_n(block.state, lanes, states);
  const std::uint8_t* next = block.next;
  std::size_t first = 0;
  while (end - first >= lanes && static_cast<std::size_t>(block.end - next) >= 2 * lanes) {
    static_assert(kMinLanes == 2 * kVectorLanes);
    for (std::size_t lane = 0; lane < lanes; lane += kMinLanes) {
      next = step(states + lane, lookup, next, out + first + lane);
      next = step(states + lane + kVectorLanes, lookup, next, out + first + lane + kVectorLanes);
    }
    first += lanes;
  }
  std::copy_n(states, lanes, block.state);
  block.next = next;
  return first;
}

}  // namespace

void rans_decode_vector(RansBlock& block, const RansLookup& lookup, std::size_t count,
                        std::uint8_t* out) {
  const std::size_t begin = block.lanes < kMinLanes ? 0 : decode_full(block, lookup, count, out);
  rans_decode_rest(block, lookup, begin, count, out);
}

void rans_decode_blocks(std::span<RansCursor> cursors, std::size_t first) {
  for (RansCursor& cursor : cursors) rans_decode_planes(cursor, first, rans_decode_vector);
}

}  // namespace stgs
