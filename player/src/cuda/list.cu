// SPDX-License-Identifier: Apache-2.0
// Instances: for each splat, nearest first, the tiles that its ellipse meets. A block takes a chunk
// of splats, counts their tiles, learns how many the chunks before have, and lists its own. Those
// of one tile are in the order of depth then, which the stable sort by tile keeps. What threads
// share among them are the chunk's rows of tiles, not its splats: the nearest splats are next to
// each other, and have many times the rows of others.
#include "cuda/footprint.cuh"
#include "cuda/frame_input.cuh"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"

namespace stgs::player::cuda {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / 32;
// Rows of a chunk whose spans are kept from counting to listing; those of others are found again.
constexpr std::uint32_t kKept = 1024;
// Instances of a chunk that go through shared memory, from where they are written in order.
constexpr std::uint32_t kStage = 3072;

struct ListShared {
  FrameInput frame;
  std::uint32_t digits[kMostPasses][kDigits];
  Footprint footprints[kThreads];
  std::uint32_t splats[kThreads];
  std::uint32_t row_begin[kThreads];  // of a splat, among the chunk's rows
  ushort2 kept[kKept];                // spans: first, count
  std::uint32_t stage[kStage];  // tile, and the splat's place in the chunk in the lower eight bits
  std::uint32_t sums[kWarps];
  std::uint32_t chunk;
  Told before;
};

// The tiles of a row of the chunk.
struct RowTiles {
  std::uint32_t splat;  // its place in the chunk
  std::uint32_t first, count;
};

// Which splat of the chunk has the row: the last of those that begin up to it.
__device__ std::uint32_t splat_of_row(const ListShared& s, std::uint32_t row) {
  std::uint32_t splat = 0;
#pragma unroll
  for (std::uint32_t step = kThreads / 2; step > 0; step /= 2) {
    if (s.row_begin[splat + step] <= row) splat += step;
  }
  return splat;
}

__device__ Span span_of_row(const ListShared& s, std::uint32_t splat, std::uint32_t row) {
  const Footprint& f = s.footprints[splat];
  return span_of(f, f.row + static_cast<int>(row - s.row_begin[splat]), s.frame.views[f.view]);
}

__device__ RowTiles tiles_of_row(const ListShared& s, std::uint32_t row) {
  const std::uint32_t splat = splat_of_row(s, row);
  const Footprint& f = s.footprints[splat];
  const ViewInput& view = s.frame.views[f.view];
  const Span span = row < kKept ? Span{s.kept[row].x, s.kept[row].y} : span_of_row(s, splat, row);
  const int line = f.row + static_cast<int>(row - s.row_begin[splat]);
  return {splat, view.first_tile + static_cast<std::uint32_t>(line * view.tiles_x + span.first),
          static_cast<std::uint32_t>(span.count)};
}

// Brings the chunk's splats and tells how many rows of tiles they have. The whole block calls it,
// as what follows.
__device__ std::uint32_t load_chunk(ListShared& s, const Workspace& w, std::uint32_t visible) {
  const std::uint32_t rank = s.chunk * kThreads + threadIdx.x;
  Footprint own{};
  if (rank < visible) {
    const std::uint32_t ordered = w.depth_order[0][rank];
    const std::uint32_t splat = ordered & (kMaxSplats - 1);
    const auto view = static_cast<int>(ordered >> kViewShift);
    s.splats[threadIdx.x] = splat;
    own = footprint_of(splat_of(load_quad(w.splats, splat)), view, s.frame.views[view]);
    s.footprints[threadIdx.x] = own;
  }
  std::uint32_t rows;
  s.row_begin[threadIdx.x] =
      block_sum_before<kWarps>(static_cast<std::uint32_t>(own.rows), s.sums, rows);
  __syncthreads();
  return rows;
}

// How many tiles the chunk's rows have: fewer than 2^31, of 256 splats in 2^22 tiles of a view.
__device__ std::uint32_t count_tiles(ListShared& s, std::uint32_t rows) {
  std::uint32_t count = 0, total;
  for (std::uint32_t row = threadIdx.x; row < rows; row += kThreads) {
    const Span span = span_of_row(s, splat_of_row(s, row), row);
    if (row < kKept) {
      s.kept[row] = {static_cast<unsigned short>(span.first),
                     static_cast<unsigned short>(span.count)};
    }
    count += static_cast<std::uint32_t>(span.count);
  }
  block_sum_before<kWarps>(count, s.sums, total);
  return total;
}

// Calls put(place, tile, splat) for each tile: `place` counts on through the chunk, `splat` is its
// place there.
template <typename Put>
__device__ void for_each_tile(ListShared& s, std::uint32_t rows, Put put) {
  std::uint32_t begin = 0;
  for (std::uint32_t first = 0; first < rows; first += kThreads) {
    const std::uint32_t row = first + threadIdx.x;
    const RowTiles own = row < rows ? tiles_of_row(s, row) : RowTiles{};
    std::uint32_t total;
    const std::uint32_t place = begin + block_sum_before<kWarps>(own.count, s.sums, total);
    for (std::uint32_t k = 0; k < own.count; ++k) put(place + k, own.first + k, own.splat);
    begin += total;
  }
}

// Writes the chunk's instances from the place `before`.
__device__ void list_chunk(ListShared& s, const Workspace& w, std::uint32_t rows,
                           std::uint32_t total, std::uint32_t before) {
  const auto write = [&](std::uint32_t to, std::uint32_t tile, std::uint32_t splat) {
    w.tile_keys[0][to] = tile;
    w.tile_splats[0][to] = s.splats[splat];
    for (int p = 0; p < w.tile_passes; ++p) atomicAdd(&s.digits[p][tile >> 8 * p & 0xFFu], 1u);
  };
  if (total > kStage) {
    for_each_tile(s, rows, [&](std::uint32_t place, std::uint32_t tile, std::uint32_t splat) {
      write(before + place, tile, splat);
    });
    return;
  }
  for_each_tile(s, rows, [&](std::uint32_t place, std::uint32_t tile, std::uint32_t splat) {
    s.stage[place] = tile << 8 | splat;
  });
  __syncthreads();
  for (std::uint32_t k = threadIdx.x; k < total; k += kThreads) {
    write(before + k, s.stage[k] >> 8, s.stage[k] & 0xFFu);
  }
}

__global__ void __launch_bounds__(kThreads) list_tiles(const FrameInput* input, const Workspace w) {
  __shared__ ListShared s;
  load_frame(input, s.frame);
  for (int p = 0; p < kMostPasses; ++p) s.digits[p][threadIdx.x] = 0;
  const std::uint32_t visible = w.counters->splats;
  for (;;) {
    if (threadIdx.x == 0) s.chunk = atomicAdd(&w.counters->list_ticket, 1u);
    __syncthreads();
    if (s.chunk >= (visible + kThreads - 1) / kThreads) break;
    const std::uint32_t rows = load_chunk(s, w, visible);
    const std::uint32_t total = count_tiles(s, rows);
    if (threadIdx.x < 32) {
      const Told found = sum_before(w.list_told, s.chunk, total);
      if (threadIdx.x == 0) {
        s.before = found;
        if ((s.chunk + 1) * kThreads >= visible) {
          const Told all = found + total;
          w.counters->instances = all;
          w.counters->listed = all <= w.instance_capacity ? static_cast<std::uint32_t>(all) : 0;
        }
      }
    }
    __syncthreads();
    if (s.before + total <= w.instance_capacity) {
      list_chunk(s, w, rows, total, static_cast<std::uint32_t>(s.before));
    }
    __syncthreads();
  }
  for (int p = 0; p < w.tile_passes; ++p) {
    const std::uint32_t n = s.digits[p][threadIdx.x];
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
