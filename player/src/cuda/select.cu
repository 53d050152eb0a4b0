// SPDX-License-Identifier: Apache-2.0
// Selects the candidates: reads only the support of each stored primitive, 8 bytes, so that the
// cost of all later stages depends on the active primitives. A warp tests a chunk. The candidates
// of a thread block follow those of the blocks before, in id order.
#include "cuda/frame_input.cuh"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"

namespace stgs::player::cuda {
namespace {

constexpr int kWarps = static_cast<int>(kSelectChunks), kThreads = 32 * kWarps;
constexpr int kEach = static_cast<int>(kChunk) / 32;  // primitives per lane

// Returns the part that contains the chunk: the last one that begins at or before it.
__device__ std::uint32_t part_of(const Part* parts, std::uint32_t count, std::uint32_t chunk) {
  std::uint32_t low = 0, high = count;
  while (high - low > 1) {
    const std::uint32_t middle = (low + high) / 2;
    if (parts[middle].first_chunk <= chunk) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

__global__ void __launch_bounds__(kThreads) select(const FrameInput* input, const Workspace w) {
  __shared__ std::uint32_t sums[kWarps];
  __shared__ std::uint32_t tile, before;
  const Part* const parts = parts_of(input);
  const std::uint32_t chunks = input->chunks, part_count = input->parts;
  const unsigned lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  for (;;) {
    if (threadIdx.x == 0) tile = atomicAdd(&w.counters->select_ticket, 1u);
    __syncthreads();
    const std::uint32_t chunk = tile * kWarps + warp;
    const std::uint32_t item = tile;
    if (item * kWarps >= chunks) break;
    unsigned active[kEach] = {};  // one bit per primitive of the chunk
    std::uint32_t part = 0, first = 0, count = 0;
    if (chunk < chunks) {
      part = part_of(parts, part_count, chunk);
      const Part at = parts[part];
      first = (chunk - at.first_chunk) * kChunk;
      const float2* const supports = packed_at(at.memory, at.primitives).support + first + lane;
      const auto ticks = static_cast<float>(at.ticks);
#pragma unroll
      for (int k = 0; k < kEach; ++k) {
        const float2 support = __ldg(supports + 32 * k);
        active[k] = __ballot_sync(kAllLanes, support.x <= ticks && ticks <= support.y);
        count += __popc(active[k]);
      }
    }
    if (lane == 0) sums[warp] = count;
    __syncthreads();
    std::uint32_t index = 0, total = 0;
    for (unsigned k = 0; k < kWarps; ++k) {
      if (k < warp) index += sums[k];
      total += sums[k];
    }
    if (warp == 0) {
      const TileStatus found = sum_before(w.select_status, item, total);
      if (lane == 0) {
        before = static_cast<std::uint32_t>(found);
        if ((item + 1) * kWarps >= chunks) w.counters->active = before + total;
      }
    }
    __syncthreads();
    index += before;
#pragma unroll
    for (int k = 0; k < kEach; ++k) {
      if ((active[k] >> lane & 1u) != 0) {
        w.candidates[index + __popc(active[k] & ((1u << lane) - 1u))] = {part,
                                                                         first + 32 * k + lane};
      }
      index += __popc(active[k]);
    }
  }
}

}  // namespace

cudaError_t select_grid(unsigned& blocks) {
  return resident_blocks(select, kThreads, blocks);
}

void launch_select(const FrameInput* input, const Workspace& w, const Grids& grids,
                   cudaStream_t stream) {
  launch(select, grids.select, kThreads, stream, input, w);
}

}  // namespace stgs::player::cuda
