// SPDX-License-Identifier: Apache-2.0
// The sorts of a frame: splats by depth, instances by tile; and the range of instances of each
// tile.
#include "cuda/draw.h"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/radix_sort.cuh"

namespace stgs::player::cuda {
namespace {

constexpr unsigned kRangeThreads = 256;

__global__ void __launch_bounds__(kSortThreads, 3) sort_pass(const SortPass pass) {
  __shared__ SortShared s;
  const std::uint32_t n = *pass.count;
  std::uint32_t all;
  const std::uint32_t digit_begin =
      block_sum_before<kSortWarps>(pass.digits[threadIdx.x], s.sums, all);
  for (;;) {
    if (threadIdx.x == 0) s.tile = atomicAdd(pass.ticket, 1u);
    __syncthreads();
    const std::uint32_t first = s.tile * kSortTile;
    if (first >= n) break;
    sort_tile(pass, first, n, digit_begin, s);
  }
}

__global__ void __launch_bounds__(kRangeThreads)
    find_ranges(const std::uint32_t* keys, const std::uint32_t* count, uint2* ranges) {
  const std::uint32_t n = *count;
  for (std::uint32_t i = blockIdx.x * kRangeThreads + threadIdx.x; i < n;
       i += gridDim.x * kRangeThreads) {
    const std::uint32_t tile = keys[i];
    if (i == 0 || keys[i - 1] != tile) ranges[tile].x = i;
    if (i + 1 == n || keys[i + 1] != tile) ranges[tile].y = i + 1;
  }
}

}  // namespace

cudaError_t sort_grids(unsigned& depth, unsigned& tile, unsigned& ranges) {
  cudaError_t error = resident_blocks(sort_pass, kSortThreads, depth);
  tile = depth;
  if (error == cudaSuccess) error = resident_blocks(find_ranges, kRangeThreads, ranges);
  return error;
}

int tile_passes(std::uint32_t tiles) {
  int passes = 1;
  while (tiles > std::uint32_t{1} << 8 * passes && passes < kMaxPasses) ++passes;
  return passes;
}

void launch_depth_sort(const Workspace& w, const Grids& grids, cudaStream_t stream) {
  for (int p = 0; p < kDepthPasses; ++p) {
    const bool last = p + 1 == kDepthPasses;
    SortPass pass;
    pass.count = &w.counters->splats;
    pass.digits = w.depth_digits + p * kDigits;
    pass.status = w.sort_status[p];
    pass.ticket = &w.counters->sort_tickets[p];
    pass.keys = w.depth_keys[p % 2];
    pass.values = w.depth_order[p % 2];
    pass.keys_out = last ? nullptr : w.depth_keys[(p + 1) % 2];
    pass.values_out = w.depth_order[(p + 1) % 2];
    pass.shift = 8 * p;
    launch(sort_pass, grids.depth_sort, kSortThreads, stream, pass);
  }
}

void launch_tile_sort(const Workspace& w, const Grids& grids, cudaStream_t stream) {
  for (int p = 0; p < w.tile_passes; ++p) {
    SortPass pass;
    pass.count = &w.counters->listed;
    pass.digits = w.tile_digits + p * kDigits;
    pass.status = w.sort_status[kMaxPasses + p];
    pass.ticket = &w.counters->sort_tickets[kMaxPasses + p];
    pass.keys = w.tile_keys[p % 2];
    pass.values = w.tile_splats[p % 2];
    pass.keys_out = w.tile_keys[(p + 1) % 2];
    pass.values_out = w.tile_splats[(p + 1) % 2];
    pass.shift = 8 * p;
    launch(sort_pass, grids.tile_sort, kSortThreads, stream, pass);
  }
  launch(find_ranges, grids.ranges, kRangeThreads, stream,
         static_cast<const std::uint32_t*>(w.tile_keys[w.tile_passes % 2]),
         static_cast<const std::uint32_t*>(&w.counters->listed), w.tile_ranges);
}

}  // namespace stgs::player::cuda
