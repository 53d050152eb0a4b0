// SPDX-License-Identifier: Apache-2.0
// Instances: for each splat, nearest first, the tiles that its ellipse meets. A block takes a chunk
// of splats, counts their tiles, learns how many the chunks before have, and lists its own. Those
// of one tile are in the order of depth then, which the stable sort by tile keeps.
#include "cuda/footprint.cuh"
#include "cuda/frame_input.cuh"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"

namespace stgs::player::cuda {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / 32;
// Rows of tiles that a thread goes through alone; a splat with more is shared by its warp.
constexpr int kAlone = 8;
// Instances of a chunk that go through shared memory, from where they are written in order.
constexpr std::uint32_t kStage = 4096;

__device__ Footprint shuffled(const Footprint& f, int lane) {
  Footprint out;
  out.x = __shfl_sync(kAllLanes, f.x, lane);
  out.y = __shfl_sync(kAllLanes, f.y, lane);
  out.per_height = __shfl_sync(kAllLanes, f.per_height, lane);
  out.slope = __shfl_sync(kAllLanes, f.slope, lane);
  out.width = __shfl_sync(kAllLanes, f.width, lane);
  out.top = __shfl_sync(kAllLanes, f.top, lane);
  out.slack = __shfl_sync(kAllLanes, f.slack, lane);
  out.view = __shfl_sync(kAllLanes, f.view, lane);
  out.row = __shfl_sync(kAllLanes, f.row, lane);
  out.rows = __shfl_sync(kAllLanes, f.rows, lane);
  return out;
}

// How many tiles the lane's splat meets. All lanes of the warp call it.
__device__ std::uint32_t count_tiles(const Footprint& own, const ViewInput* views) {
  const int lane = static_cast<int>(threadIdx.x & 31);
  std::uint32_t count = 0;
  if (own.rows <= kAlone) {
    const ViewInput& view = views[own.view];
    for (int r = 0; r < own.rows; ++r) count += span_of(own, own.row + r, view).count;
  }
  unsigned large = __ballot_sync(kAllLanes, own.rows > kAlone);
  while (large != 0) {
    const int owner = __ffs(static_cast<int>(large)) - 1;
    large &= large - 1;
    const Footprint f = shuffled(own, owner);
    const ViewInput& view = views[f.view];
    std::uint32_t found = 0;
    for (int r = lane; r < f.rows; r += 32) found += span_of(f, f.row + r, view).count;
    found = warp_sum(found);
    if (lane == owner) count = found;
  }
  return count;
}

__device__ std::uint32_t tile_at(const ViewInput& view, int row, int column) {
  return view.first_tile + static_cast<std::uint32_t>(row * view.tiles_x + column);
}

// Calls put(place, tile, thread) for each tile that the lanes' splats meet: `place` counts on from
// the splat's `begin`, `thread` is the splat's in the block. All lanes of the warp call it.
template <typename Put>
__device__ void for_each_tile(const Footprint& own, std::uint32_t begin, const ViewInput* views,
                              Put put) {
  const int lane = static_cast<int>(threadIdx.x & 31);
  if (own.rows <= kAlone) {
    const ViewInput& view = views[own.view];
    std::uint32_t place = begin;
    for (int r = 0; r < own.rows; ++r) {
      const Span span = span_of(own, own.row + r, view);
      const std::uint32_t tile = tile_at(view, own.row + r, span.first);
      for (int k = 0; k < span.count; ++k) put(place++, tile + k, threadIdx.x);
    }
  }
  unsigned large = __ballot_sync(kAllLanes, own.rows > kAlone);
  while (large != 0) {
    const int owner = __ffs(static_cast<int>(large)) - 1;
    large &= large - 1;
    const Footprint f = shuffled(own, owner);
    const ViewInput& view = views[f.view];
    std::uint32_t place = __shfl_sync(kAllLanes, begin, owner);
    for (int r = 0; r < f.rows; ++r) {
      const Span span = span_of(f, f.row + r, view);
      const std::uint32_t tile = tile_at(view, f.row + r, span.first);
      for (int k = lane; k < span.count; k += 32) {
        put(place + k, tile + k, threadIdx.x - lane + owner);
      }
      place += span.count;
    }
  }
}

__global__ void __launch_bounds__(kThreads) list_tiles(const FrameInput* input, const Workspace w) {
  __shared__ FrameInput frame;
  __shared__ std::uint32_t digits[kMostPasses][kDigits];
  __shared__ std::uint32_t stage[kStage];  // tile, and the splat's thread in the lower eight bits
  __shared__ std::uint32_t splats[kThreads];
  __shared__ std::uint32_t sums[kWarps];
  __shared__ std::uint32_t chunk;
  __shared__ Told before;
  load_frame(input, frame);
  for (int p = 0; p < kMostPasses; ++p) digits[p][threadIdx.x] = 0;
  const std::uint32_t visible = w.counters->splats;
  const auto write = [&](std::uint32_t to, std::uint32_t tile, std::uint32_t thread) {
    w.tile_keys[0][to] = tile;
    w.tile_splats[0][to] = splats[thread];
    for (int p = 0; p < w.tile_passes; ++p) atomicAdd(&digits[p][tile >> 8 * p & 0xFFu], 1u);
  };
  for (;;) {
    if (threadIdx.x == 0) chunk = atomicAdd(&w.counters->list_ticket, 1u);
    __syncthreads();
    if (chunk >= (visible + kThreads - 1) / kThreads) break;
    const std::uint32_t rank = chunk * kThreads + threadIdx.x;
    Footprint own{};
    if (rank < visible) {
      const std::uint32_t ordered = w.depth_order[0][rank];
      const std::uint32_t splat = ordered & (kMaxSplats - 1);
      const auto view = static_cast<int>(ordered >> kViewShift);
      splats[threadIdx.x] = splat;
      own = footprint_of(splat_of(load_quad(w.splats, splat)), view, frame.views[view]);
    }
    // A chunk has fewer than 2^31: 256 splats in 2^22 tiles of a view.
    std::uint32_t total;
    const std::uint32_t begin =
        block_sum_before<kWarps>(count_tiles(own, frame.views), sums, total);
    if (threadIdx.x < 32) {
      const Told found = sum_before(w.list_told, chunk, total);
      if (threadIdx.x == 0) {
        before = found;
        if ((chunk + 1) * kThreads >= visible) {
          const Told all = found + total;
          w.counters->instances = all;
          w.counters->listed = all <= w.instance_capacity ? static_cast<std::uint32_t>(all) : 0;
        }
      }
    }
    __syncthreads();
    if (before + total <= w.instance_capacity) {
      const auto first = static_cast<std::uint32_t>(before);
      if (total <= kStage) {
        for_each_tile(own, begin, frame.views,
                      [&](std::uint32_t place, std::uint32_t tile, unsigned thread) {
                        stage[place] = tile << 8 | thread;
                      });
        __syncthreads();
        for (std::uint32_t k = threadIdx.x; k < total; k += kThreads) {
          write(first + k, stage[k] >> 8, stage[k] & 0xFFu);
        }
      } else {
        for_each_tile(own, begin, frame.views,
                      [&](std::uint32_t place, std::uint32_t tile, unsigned thread) {
                        write(first + place, tile, thread);
                      });
      }
    }
    __syncthreads();
  }
  for (int p = 0; p < w.tile_passes; ++p) {
    const std::uint32_t n = digits[p][threadIdx.x];
    if (n != 0) atomicAdd(w.tile_digits + p * kDigits + threadIdx.x, n);
  }
}

}  // namespace

cudaError_t list_grid(unsigned& blocks) {
  return resident_blocks(list_tiles, kThreads, blocks);
}

void launch_list(const FrameInput* input, const Workspace& w, const Grids& grids,
                 cudaStream_t stream) {
  launch(list_tiles, grids.list, kThreads, stream, input, w);
}

cudaError_t find_grids(int sh_degree, Grids& grids) {
  cudaError_t error = select_grid(grids.select);
  if (error == cudaSuccess) {
    error = project_grids(sh_degree, grids.project_one, grids.project_several);
  }
  if (error == cudaSuccess) error = list_grid(grids.list);
  if (error == cudaSuccess) error = sort_grids(grids.depth_sort, grids.tile_sort, grids.ranges);
  return error;
}

}  // namespace stgs::player::cuda
