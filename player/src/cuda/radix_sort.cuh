// SPDX-License-Identifier: Apache-2.0
// A pass of a stable radix sort by eight bits in one kernel (A. Adinets, D. Merrill, "Onesweep",
// 2022). CUB takes the number of keys from the host; here only the device knows it, and a frame
// must not wait for it. The kernels that write the keys also count the digits of all passes.
#pragma once

#include "cuda/draw.h"
#include "cuda/look_back.cuh"

namespace stgs::player::cuda {

inline constexpr int kSortThreads = kDigits;  // one digit each
inline constexpr int kSortWarps = kSortThreads / 32;
inline constexpr int kSortItems = static_cast<int>(kSortTile) / kSortThreads;

// The kind of the published count of a digit in a sort tile, in the upper two bits; 0: not yet
// published.
inline constexpr std::uint32_t kDigitAggregate = 1u << 30, kDigitPrefix = 2u << 30;
inline constexpr std::uint32_t kDigitValue = kDigitAggregate - 1;
// Counts of earlier tiles that are loaded at once to hide memory latency.
inline constexpr int kDigitsAhead = 8;

struct SortPass {
  const std::uint32_t* count = nullptr;   // number of keys
  const std::uint32_t* digits = nullptr;  // keys with each digit
  std::uint32_t* status = nullptr;        // kDigits per sort tile, cleared
  std::uint32_t* ticket = nullptr;        // cleared
  const std::uint32_t* keys = nullptr;
  const std::uint32_t* values = nullptr;
  std::uint32_t* keys_out = nullptr;  // null: not needed
  std::uint32_t* values_out = nullptr;
  int shift = 0;  // of the digit
};

// Returns the number of keys with a digit in the tiles before `tile`.
__device__ inline std::uint32_t digits_before(const std::uint32_t* status, std::uint32_t tile,
                                              unsigned digit) {
  const volatile std::uint32_t* const at = status + digit;
  std::uint32_t sum = 0;
  long long last = static_cast<long long>(tile) - 1;
  while (last >= 0) {
    std::uint32_t words[kDigitsAhead];
#pragma unroll
    for (int k = 0; k < kDigitsAhead; ++k) {
      words[k] = last - k >= 0 ? at[(last - k) * kDigits] : kDigitPrefix;
    }
#pragma unroll
    for (int k = 0; k < kDigitsAhead; ++k) {
      if (words[k] == 0) break;  // retry from this tile
      sum += words[k] & kDigitValue;
      if ((words[k] & kDigitPrefix) != 0) return sum;
      --last;
    }
  }
  return sum;
}

struct SortShared {
  std::uint32_t counts[kSortWarps]
                      [kDigits];  // a warp's keys by digit; then the sum of the warps before
  std::uint32_t start[kDigits];   // first index of a digit's keys in the tile
  std::uint32_t to[kDigits];      // offset from an index in the tile to the output index
  std::uint32_t keys[kSortTile], values[kSortTile];
  std::uint32_t sums[kSortWarps];
  std::uint32_t tile;
};

// Returns the lanes with the same digit.
__device__ inline unsigned match_lanes(std::uint32_t digit) {
  unsigned matching = kAllLanes;
#pragma unroll
  for (int bit = 0; bit < 8; ++bit) {
    const bool set = (digit >> bit & 1u) != 0;
    const unsigned with = __ballot_sync(kAllLanes, set);
    matching &= set ? with : ~with;
  }
  return matching;
}

__device__ inline void sort_tile(const SortPass& pass, std::uint32_t first, std::uint32_t n,
                                 std::uint32_t digit_begin, SortShared& s) {
  const unsigned thread = threadIdx.x, lane = thread & 31, warp = thread / 32;
  const std::uint32_t tile = first / kSortTile;
  for (int w = 0; w < kSortWarps; ++w) s.counts[w][thread] = 0;
  // A warp has successive keys, so that equal keys keep their order. Padding keys sort last and are
  // not written.
  std::uint32_t keys[kSortItems], values[kSortItems];
  std::uint32_t ranks[kSortItems / 2];  // among the warp's keys with the digit; 16 bits each
  const std::uint32_t mine = first + warp * 32 * kSortItems + lane;
  const int left = static_cast<int>(n - first) - static_cast<int>(mine - first);
  const std::uint32_t* const keys_in = pass.keys + mine;
#pragma unroll
  for (int k = 0; k < kSortItems; ++k) {
    keys[k] = 32 * k < left ? keys_in[32 * k] : 0xFFFFFFFFu;
  }
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kSortItems; ++k) {
    const std::uint32_t digit = keys[k] >> pass.shift & 0xFFu;
    const unsigned matching = match_lanes(digit);
    const unsigned below = __popc(matching & ((1u << lane) - 1u));
    const std::uint32_t before = s.counts[warp][digit];
    __syncwarp();
    if (below == 0) s.counts[warp][digit] = before + __popc(matching);
    __syncwarp();
    ranks[k / 2] = k % 2 == 0 ? before + below : ranks[k / 2] | (before + below) << 16;
  }
  __syncthreads();
  std::uint32_t own = 0;
  for (int w = 0; w < kSortWarps; ++w) {
    const std::uint32_t n_w = s.counts[w][thread];
    s.counts[w][thread] = own;
    own += n_w;
  }
  volatile std::uint32_t* const status = pass.status + std::size_t{tile} * kDigits + thread;
  *status = (tile == 0 ? kDigitPrefix : kDigitAggregate) | own;
  const std::uint32_t* const values_in = pass.values + mine;
  // Loaded here and not with the keys, to save registers.
#pragma unroll
  for (int k = 0; k < kSortItems; ++k) {
    values[k] = 32 * k < left ? values_in[32 * k] : 0;
  }
  std::uint32_t total;
  const std::uint32_t start = block_sum_before<kSortWarps>(own, s.sums, total);
  s.start[thread] = start;
  __syncthreads();
#pragma unroll
  for (int k = 0; k < kSortItems; ++k) {
    const std::uint32_t digit = keys[k] >> pass.shift & 0xFFu;
    const std::uint32_t index = s.start[digit] + s.counts[warp][digit] +
                                (k % 2 == 0 ? ranks[k / 2] & 0xFFFFu : ranks[k / 2] >> 16);
    s.keys[index] = keys[k];
    s.values[index] = values[k];
  }
  const std::uint32_t before = digits_before(pass.status, tile, thread);
  if (tile > 0) *status = kDigitPrefix | (before + own);
  s.to[thread] = digit_begin + before - start;
  __syncthreads();
  const std::uint32_t count_in_tile = n - first < kSortTile ? n - first : kSortTile;
  for (std::uint32_t index = thread; index < count_in_tile; index += kSortThreads) {
    const std::uint32_t key = s.keys[index];
    const std::uint32_t to = s.to[key >> pass.shift & 0xFFu] + index;
    if (pass.keys_out != nullptr) pass.keys_out[to] = key;
    pass.values_out[to] = s.values[index];
  }
  __syncthreads();
}

}  // namespace stgs::player::cuda
