// SPDX-License-Identifier: Apache-2.0
// Lists the instances: for each splat, nearest first, the tiles that its ellipse meets, and which
// of their quarters, so that the blend need not test them. A thread block takes a chunk of splats,
// counts their tiles, obtains the count of the chunks before, and lists its own. The instances of a
// tile are thus in depth order, which the stable sort by tile preserves. The rows of tiles of a
// chunk are distributed over the threads, not its splats: the nearest splats are adjacent and have
// many times more rows than others.
#include "cuda/footprint.cuh"
#include "cuda/frame_input.cuh"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"

namespace stgs::player::cuda {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / 32;
static_assert(kListSplats <= kThreads && kNearSplats <= kListSplats);
// Rows of a chunk whose cells are cached between counting and listing; those of further rows are
// computed again.
constexpr std::uint32_t kMaxCachedRows = 1024;
// Instances of a chunk that are staged in shared memory for coalesced writes.
constexpr std::uint32_t kMaxStaged = 3072;

struct ListShared {
  FrameInput frame;
  std::uint32_t digits[kMaxPasses][kDigits];
  Footprint footprints[kThreads];
  std::uint32_t splats[kThreads];
  std::uint32_t row_begin[kThreads];  // first row of a splat, among the chunk's rows
  ushort4 cached[kMaxCachedRows];     // first and count of the upper half, then of the lower
  std::uint32_t staged[kMaxStaged];   // tile; in the lower 8 bits, the splat's index in the chunk
  std::uint8_t staged_met[kMaxStaged];
  std::uint32_t sums[kWarps];
  std::uint32_t chunk;
  TileStatus before;
};

// A row of a splat of the chunk: of tiles, or with foveae, of squares of 2 x 2 tiles.
struct Row {
  std::uint32_t number;  // among the chunk's rows
  std::uint32_t splat;   // its index in the chunk
  int line;              // of the view's rows
};

// The instances of a row.
struct RowTiles {
  Row row;
  Cells met;         // quarters of its tiles; with foveae, tiles of its squares
  Span tiles[2];     // tiles at full resolution; [1]: of the second line of squares
  Span left, right;  // squares at half resolution on either side of them
  __device__ std::uint32_t count() const {
    return static_cast<std::uint32_t>(tiles[0].count + tiles[1].count + left.count + right.count);
  }
};

// Finds the splat of the chunk that has the row: the last one that begins at or before it.
__device__ Row find_row(const ListShared& s, std::uint32_t row) {
  std::uint32_t splat = 0;
#pragma unroll
  for (std::uint32_t step = kThreads / 2; step > 0; step /= 2) {
    if (s.row_begin[splat + step] <= row) splat += step;
  }
  return {row, splat, s.footprints[splat].row + static_cast<int>(row - s.row_begin[splat])};
}

// Returns the cells of kPixels that are met in the two halves of a row.
template <int kPixels>
__device__ Cells find_cells(const Footprint& f, int row, const ViewInput& view) {
  return {span_of<kPixels>(f, 2 * row, view), span_of<kPixels>(f, 2 * row + 1, view)};
}

// Returns the cells of a row of the chunk. Caches them while counting.
template <int kPixels>
__device__ Cells cells_of_row(ListShared& s, const Row& row, bool counting) {
  const Footprint& f = s.footprints[row.splat];
  const ViewInput& view = s.frame.views[f.view];
  if (row.number >= kMaxCachedRows) return find_cells<kPixels>(f, row.line, view);
  ushort4& cached = s.cached[row.number];
  if (!counting) return {{cached.x, cached.y}, {cached.z, cached.w}};
  const Cells cells = find_cells<kPixels>(f, row.line, view);
  cached = make_ushort4(static_cast<unsigned short>(cells.upper.first),
                        static_cast<unsigned short>(cells.upper.count),
                        static_cast<unsigned short>(cells.lower.first),
                        static_cast<unsigned short>(cells.lower.count));
  return cells;
}

template <bool kFovea>
__device__ RowTiles tiles_of_row(ListShared& s, std::uint32_t number, bool counting) {
  RowTiles out{};
  out.row = find_row(s, number);
  if constexpr (!kFovea) {
    out.met = cells_of_row<kQuarterPixels>(s, out.row, counting);
    out.tiles[0] = tiles_of_cells(out.met);
  } else {
    const ViewInput& view = s.frame.views[s.footprints[out.row.splat].view];
    out.met = cells_of_row<kTilePixels>(s, out.row, counting);
    const Span sharp = sharp_squares(view, out.row.line), squares = tiles_of_cells(out.met);
    const Span sharp_tiles = {2 * sharp.first, 2 * sharp.count};
    out.tiles[0] = intersection(out.met.upper, sharp_tiles);
    out.tiles[1] = intersection(out.met.lower, sharp_tiles);
    const int end = squares.first + squares.count;
    out.left = intersection(squares, {0, sharp.count > 0 ? sharp.first : end});
    if (sharp.count > 0) out.right = intersection(squares, {sharp.first + sharp.count, end});
  }
  return out;
}

// Calls emit(tile, met) for each instance of a row.
template <bool kFovea, typename Emit>
__device__ void list_row(const ListShared& s, const RowTiles& own, Emit emit) {
  const Footprint& f = s.footprints[own.row.splat];
  const ViewInput& view = s.frame.views[f.view];
  const auto list = [&](const Span& tiles, int line, const Cells& met) {
    const auto first = view.first_tile + static_cast<std::uint32_t>(line * view.tiles_x);
    for (int k = tiles.first; k < tiles.first + tiles.count; ++k) {
      emit(first + static_cast<std::uint32_t>(k), met_of(met, k));
    }
  };
  if constexpr (!kFovea) {
    list(own.tiles[0], own.row.line, own.met);
  } else {
    const int line = 2 * own.row.line;
    for (int k = 0; k < 2; ++k) {
      if (own.tiles[k].count == 0) continue;
      list(own.tiles[k], line + k, find_cells<kQuarterPixels>(f, line + k, view));
    }
    const auto first = view.first_tile + static_cast<std::uint32_t>(line * view.tiles_x);
    for (const Span& squares : {own.left, own.right}) {
      for (int k = squares.first; k < squares.first + squares.count; ++k) {
        emit(first + static_cast<std::uint32_t>(2 * k), met_of(own.met, k));
      }
    }
  }
}

// Returns the first splat of a chunk.
__device__ std::uint32_t chunk_begin(std::uint32_t chunk) {
  const std::uint32_t near = min(chunk, kNearChunks);
  return near * kNearSplats + (chunk - near) * kListSplats;
}

// Loads the chunk's splats and returns the number of their rows. The whole block calls this and the
// following functions.
template <int kRowPixels>
__device__ std::uint32_t load_chunk(ListShared& s, const Workspace& w, std::uint32_t visible) {
  const std::uint32_t rank = chunk_begin(s.chunk) + threadIdx.x;
  Footprint own{};
  if (rank < min(visible, chunk_begin(s.chunk + 1))) {
    const std::uint32_t ordered = w.depth_order[0][rank];
    const std::uint32_t splat = ordered & (kMaxSplats - 1);
    const auto view = static_cast<int>(ordered >> kSplatBits);
    s.splats[threadIdx.x] = splat;
    own = footprint_of<kRowPixels>(load_splat(w.splats, splat), view, s.frame.views[view]);
    s.footprints[threadIdx.x] = own;
  }
  std::uint32_t rows;
  s.row_begin[threadIdx.x] =
      block_sum_before<kWarps>(static_cast<std::uint32_t>(own.rows), s.sums, rows);
  __syncthreads();
  return rows;
}

// Returns the number of instances of the chunk: less than 2^31, for 256 splats in 2^22 tiles of a
// view.
template <bool kFovea>
__device__ std::uint32_t count_tiles(ListShared& s, std::uint32_t rows) {
  std::uint32_t count = 0, total;
  for (std::uint32_t row = threadIdx.x; row < rows; row += kThreads) {
    count += tiles_of_row<kFovea>(s, row, true).count();
  }
  block_sum_before<kWarps>(count, s.sums, total);
  return total;
}

// Calls emit(index, tile, splat, met) for each instance of the chunk. `index` counts the instances,
// `splat` is the index of the splat in the chunk.
template <bool kFovea, typename Emit>
__device__ void for_each_tile(ListShared& s, std::uint32_t rows, Emit emit) {
  std::uint32_t begin = 0;
  for (std::uint32_t first = 0; first < rows; first += kThreads) {
    const std::uint32_t number = first + threadIdx.x;
    RowTiles own{};
    if (number < rows) own = tiles_of_row<kFovea>(s, number, false);
    std::uint32_t total;
    std::uint32_t index = begin + block_sum_before<kWarps>(own.count(), s.sums, total);
    begin += total;
    if (own.count() == 0) continue;
    list_row<kFovea>(s, own, [&](std::uint32_t tile, std::uint32_t met) {
      emit(index++, tile, own.row.splat, met);
    });
  }
}

// Writes the chunk's instances at index `before`.
template <bool kFovea>
__device__ void list_chunk(ListShared& s, const Workspace& w, std::uint32_t rows,
                           std::uint32_t total, std::uint32_t before) {
  const auto write = [&](std::uint32_t to, std::uint32_t tile, std::uint32_t splat,
                         std::uint32_t met) {
    w.tile_keys[0][to] = tile;
    w.tile_splats[0][to] = s.splats[splat] | met << kSplatBits;
    for (int p = 0; p < w.tile_passes; ++p) atomicAdd(&s.digits[p][tile >> 8 * p & 0xFFu], 1u);
  };
  if (total > kMaxStaged) {
    for_each_tile<kFovea>(s, rows,
                          [&](std::uint32_t index, std::uint32_t tile, std::uint32_t splat,
                              std::uint32_t met) { write(before + index, tile, splat, met); });
    return;
  }
  for_each_tile<kFovea>(
      s, rows,
      [&](std::uint32_t index, std::uint32_t tile, std::uint32_t splat, std::uint32_t met) {
        s.staged[index] = tile << 8 | splat;
        s.staged_met[index] = static_cast<std::uint8_t>(met);
      });
  __syncthreads();
  for (std::uint32_t k = threadIdx.x; k < total; k += kThreads) {
    write(before + k, s.staged[k] >> 8, s.staged[k] & 0xFFu, s.staged_met[k]);
  }
}

template <bool kFovea>
__global__ void __launch_bounds__(kThreads) list_tiles(const FrameInput* input, const Workspace w) {
  constexpr int kRowPixels = kFovea ? math::kFoveaSquare : kTilePixels;
  __shared__ ListShared s;
  load_frame(input, s.frame);
  for (int p = 0; p < kMaxPasses; ++p) s.digits[p][threadIdx.x] = 0;
  const std::uint32_t visible = w.counters->splats;
  for (;;) {
    if (threadIdx.x == 0) s.chunk = atomicAdd(&w.counters->list_ticket, 1u);
    __syncthreads();
    if (chunk_begin(s.chunk) >= visible) break;
    const std::uint32_t rows = load_chunk<kRowPixels>(s, w, visible);
    const std::uint32_t total = count_tiles<kFovea>(s, rows);
    if (threadIdx.x < 32) {
      const TileStatus found = sum_before(w.list_status, s.chunk, total);
      if (threadIdx.x == 0) {
        s.before = found;
        if (chunk_begin(s.chunk + 1) >= visible) {
          const TileStatus all = found + total;
          w.counters->instances = all;
          w.counters->listed = all <= w.instance_capacity ? static_cast<std::uint32_t>(all) : 0;
        }
      }
    }
    __syncthreads();
    if (s.before + total <= w.instance_capacity) {
      list_chunk<kFovea>(s, w, rows, total, static_cast<std::uint32_t>(s.before));
    }
    __syncthreads();
  }
  for (int p = 0; p < w.tile_passes; ++p) {
    const std::uint32_t n = s.digits[p][threadIdx.x];
    if (n != 0) atomicAdd(w.tile_digits + p * kDigits + threadIdx.x, n);
  }
}

}  // namespace

cudaError_t list_grids(unsigned& plain, unsigned& fovea) {
  cudaError_t error = resident_blocks(list_tiles<false>, kThreads, plain);
  if (error == cudaSuccess) error = resident_blocks(list_tiles<true>, kThreads, fovea);
  return error;
}

void launch_list(bool fovea, const FrameInput* input, const Workspace& w, const Grids& grids,
                 cudaStream_t stream) {
  launch(fovea ? list_tiles<true> : list_tiles<false>, fovea ? grids.list_fovea : grids.list,
         kThreads, stream, input, w);
}

cudaError_t find_grids(int sh_degree, Grids& grids) {
  cudaError_t error = select_grid(grids.select);
  if (error == cudaSuccess) {
    error = project_grids(sh_degree, grids.project_one, grids.project_several);
  }
  if (error == cudaSuccess) error = list_grids(grids.list, grids.list_fovea);
  if (error == cudaSuccess) error = sort_grids(grids.depth_sort, grids.tile_sort, grids.ranges);
  return error;
}

}  // namespace stgs::player::cuda
