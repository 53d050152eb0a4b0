// SPDX-License-Identifier: Apache-2.0
// Prefix sums in one pass (D. Merrill, M. Garland, "Single-pass Parallel Prefix Scan with Decoupled
// Look-back", 2016): each tile publishes its aggregate, then its inclusive prefix. Tiles are taken
// in ascending order by tickets, so that every tile that is waited for is running.
#pragma once

#include "stgs/format/math/cuda.cuh"

namespace stgs::player::cuda {

using math::kAllLanes;
using math::load_splat;
using math::warp_sum;

// The published value of a tile, with its kind in the upper two bits; 0: not yet published.
// Accessed as a single word, so that no fence is needed.
using TileStatus = unsigned long long;
inline constexpr TileStatus kAggregate = TileStatus{1} << 62;        // sum of this tile
inline constexpr TileStatus kInclusivePrefix = TileStatus{1} << 63;  // sum of all tiles up to this
inline constexpr TileStatus kValue = kAggregate - 1;

__device__ inline TileStatus load(const TileStatus* at) {
  return *static_cast<const volatile TileStatus*>(at);
}
__device__ inline void publish(TileStatus* at, TileStatus value) {
  *static_cast<volatile TileStatus*>(at) = value;
}

// Publishes `own`, the aggregate of `tile`, and returns the sum of the tiles before it. The whole
// warp calls it, with the same arguments; all lanes get the result.
__device__ inline TileStatus sum_before(TileStatus* status, std::uint32_t tile, TileStatus own) {
  const int lane = static_cast<int>(threadIdx.x & 31);
  if (lane == 0) publish(status + tile, (tile == 0 ? kInclusivePrefix : kAggregate) | own);
  TileStatus sum = 0;
  // Lane l reads the tile l before `last`; the sum before the first tile is 0.
  for (long long last = static_cast<long long>(tile) - 1; last >= 0; last -= 32) {
    const long long at = last - lane;
    TileStatus word = 0;
    do {
      word = at >= 0 ? load(status + at) : kInclusivePrefix;
    } while (__any_sync(kAllLanes, word == 0));
    const unsigned complete = __ballot_sync(kAllLanes, (word & kInclusivePrefix) != 0);
    const int first = complete != 0 ? __ffs(static_cast<int>(complete)) - 1 : 31;
    sum += warp_sum(lane <= first ? word & kValue : TileStatus{0});
    if (complete != 0) break;
  }
  if (lane == 0 && tile > 0) publish(status + tile, kInclusivePrefix | (sum + own));
  return sum;
}

// Returns the sum of `own` over the threads before this one in the block; `total`: over all. kWarps
// >= 2 warps; `sums` is shared memory. Ends with a barrier, after which `sums` may be reused.
template <int kWarps>
__device__ inline std::uint32_t block_sum_before(std::uint32_t own, std::uint32_t (&sums)[kWarps],
                                                 std::uint32_t& total) {
  const unsigned lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  std::uint32_t inclusive = own;
  for (unsigned step = 1; step < 32; step <<= 1) {
    const std::uint32_t before = __shfl_up_sync(kAllLanes, inclusive, step);
    if (lane >= step) inclusive += before;
  }
  if (lane == 31) sums[warp] = inclusive;
  __syncthreads();
  std::uint32_t before_warp = 0;
  total = 0;
  for (unsigned w = 0; w < kWarps; ++w) {
    if (w < warp) before_warp += sums[w];
    total += sums[w];
  }
  __syncthreads();
  return before_warp + inclusive - own;
}

}  // namespace stgs::player::cuda
