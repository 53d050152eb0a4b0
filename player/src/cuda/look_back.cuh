// SPDX-License-Identifier: Apache-2.0
// Sums over what comes before, in one pass (D. Merrill, M. Garland, "Single-pass Parallel Prefix
// Scan with Decoupled Look-back", 2016): an item's number tells what it adds, then what all up to
// it add. Items are taken in ascending order by tickets, so that whoever is waited for is running.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>

namespace stgs::player::cuda {

inline constexpr unsigned kAllLanes = 0xFFFFFFFFu;

// A number that others wait for; 0: not yet told. Read and written whole, so no fence is needed.
using Told = unsigned long long;
inline constexpr Told kOwn = Told{1} << 62;   // what this item adds
inline constexpr Told kUpTo = Told{1} << 63;  // what all items up to this one add
inline constexpr Told kValue = kOwn - 1;

__device__ inline Told read_told(const Told* at) {
  return *static_cast<const volatile Told*>(at);
}
__device__ inline void tell(Told* at, Told value) {
  *static_cast<volatile Told*>(at) = value;
}

template <typename T>
__device__ inline T warp_sum(T x) {
  for (int step = 16; step > 0; step >>= 1) x += __shfl_xor_sync(kAllLanes, x, step);
  return x;
}

// Sum of what the items before `item` add, in all lanes of the warp that calls it; `own` is the
// same in all.
__device__ inline Told sum_before(Told* told, std::uint32_t item, Told own) {
  const int lane = static_cast<int>(threadIdx.x & 31);
  if (lane == 0) tell(told + item, (item == 0 ? kUpTo : kOwn) | own);
  Told sum = 0;
  // Lane l looks at the item l before `last`; before the first there is nothing to add.
  for (long long last = static_cast<long long>(item) - 1; last >= 0; last -= 32) {
    const long long at = last - lane;
    Told word = 0;
    do {
      word = at >= 0 ? read_told(told + at) : kUpTo;
    } while (__any_sync(kAllLanes, word == 0));
    const unsigned whole = __ballot_sync(kAllLanes, (word & kUpTo) != 0);
    const int first = whole != 0 ? __ffs(static_cast<int>(whole)) - 1 : 31;
    sum += warp_sum(lane <= first ? word & kValue : Told{0});
    if (whole != 0) break;
  }
  if (lane == 0 && item > 0) tell(told + item, kUpTo | (sum + own));
  return sum;
}

// Sum of what the threads before this one in the block add; `total`: of all. kWarps >= 2 warps;
// `sums` is shared memory. Ends with a barrier after which `sums` may be used again.
template <int kWarps>
__device__ inline std::uint32_t block_sum_before(std::uint32_t own, std::uint32_t (&sums)[kWarps],
                                                 std::uint32_t& total) {
  const unsigned lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  std::uint32_t up_to = own;
  for (unsigned step = 1; step < 32; step <<= 1) {
    const std::uint32_t before = __shfl_up_sync(kAllLanes, up_to, step);
    if (lane >= step) up_to += before;
  }
  if (lane == 31) sums[warp] = up_to;
  __syncthreads();
  std::uint32_t before_warp = 0;
  total = 0;
  for (unsigned w = 0; w < kWarps; ++w) {
    if (w < warp) before_warp += sums[w];
    total += sums[w];
  }
  __syncthreads();
  return before_warp + up_to - own;
}

}  // namespace stgs::player::cuda
