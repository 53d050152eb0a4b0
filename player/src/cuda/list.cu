// SPDX-License-Identifier: Apache-2.0
// Instances: for each splat, nearest first, the tiles that its ellipse meets, and which quarters of
// them, so that the blend need not look. A block takes a chunk of splats, counts their tiles,
// learns how many the chunks before have, and lists its own. Those of one tile are in the order of
// depth then, which the stable sort by tile keeps. What threads share among them are the chunk's
// rows of tiles, not its splats: the nearest splats are next to each other, and have many times the
// rows of others.
#include "cuda/footprint.cuh"
#include "cuda/frame_input.cuh"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"

namespace stgs::player::cuda {
namespace {

constexpr int kThreads = 256, kWarps = kThreads / 32;
static_assert(kListSplats <= kThreads && kNearSplats <= kListSplats);
// Rows of a chunk whose cells are kept from counting to listing; those of others are found
// again.
constexpr std::uint32_t kKept = 1024;
// Instances of a chunk that go through shared memory, from where they are written in order.
constexpr std::uint32_t kStage = 3072;

struct ListShared {
  FrameInput frame;
  std::uint32_t digits[kMostPasses][kDigits];
  Footprint footprints[kThreads];
  std::uint32_t splats[kThreads];
  std::uint32_t row_begin[kThreads];  // of a splat, among the chunk's rows
  ushort4 kept[kKept];                // first and count of the upper half, of the lower
  std::uint32_t stage[kStage];  // tile, and the splat's place in the chunk in the lower eight bits
  std::uint8_t stage_met[kStage];
  std::uint32_t sums[kWarps];
  std::uint32_t chunk;
  Told before;
};

// A row of a splat of the chunk: of tiles, or where there are foveae of squares of 2 x 2.
struct Row {
  std::uint32_t number;  // among the chunk's rows
  std::uint32_t splat;   // its place in the chunk
  int line;              // of the view's rows
};

// What a row lists.
struct RowTiles {
  Row row;
  Cells met;         // of its tiles the quarters; of its squares the tiles
  Span tiles[2];     // of its line; of a square's two lines those at full resolution
  Span left, right;  // squares at half resolution to either side of them
  __device__ std::uint32_t count() const {
    return static_cast<std::uint32_t>(tiles[0].count + tiles[1].count + left.count + right.count);
  }
};

// Which splat of the chunk has the row: the last of those that begin up to it.
__device__ Row find_row(const ListShared& s, std::uint32_t row) {
  std::uint32_t splat = 0;
#pragma unroll
  for (std::uint32_t step = kThreads / 2; step > 0; step /= 2) {
    if (s.row_begin[splat + step] <= row) splat += step;
  }
  return {row, splat, s.footprints[splat].row + static_cast<int>(row - s.row_begin[splat])};
}

// Which squares of kPixels are met in the two lines of them that the row has.
template <int kPixels>
__device__ Cells find_cells(const Footprint& f, int row, const ViewInput& view) {
  return {span_of<kPixels>(f, 2 * row, view), span_of<kPixels>(f, 2 * row + 1, view)};
}

// The same of a row of the chunk. Counting keeps them.
template <int kPixels>
__device__ Cells cells_of_row(ListShared& s, const Row& row, bool counting) {
  const Footprint& f = s.footprints[row.splat];
  const ViewInput& view = s.frame.views[f.view];
  if (row.number >= kKept) return find_cells<kPixels>(f, row.line, view);
  ushort4& kept = s.kept[row.number];
  if (!counting) return {{kept.x, kept.y}, {kept.z, kept.w}};
  const Cells cells = find_cells<kPixels>(f, row.line, view);
  kept = make_ushort4(static_cast<unsigned short>(cells.upper.first),
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
    out.tiles[0] = wholes_of(out.met);
  } else {
    const ViewInput& view = s.frame.views[s.footprints[out.row.splat].view];
    out.met = cells_of_row<kTilePixels>(s, out.row, counting);
    const Span sharp = sharp_squares(view, out.row.line), squares = wholes_of(out.met);
    const Span sharp_tiles = {2 * sharp.first, 2 * sharp.count};
    out.tiles[0] = shared_by(out.met.upper, sharp_tiles);
    out.tiles[1] = shared_by(out.met.lower, sharp_tiles);
    const int end = squares.first + squares.count;
    out.left = shared_by(squares, {0, sharp.count > 0 ? sharp.first : end});
    if (sharp.count > 0) out.right = shared_by(squares, {sharp.first + sharp.count, end});
  }
  return out;
}

// Calls put(tile, met) for each that the row lists.
template <bool kFovea, typename Put>
__device__ void list_row(const ListShared& s, const RowTiles& own, Put put) {
  const Footprint& f = s.footprints[own.row.splat];
  const ViewInput& view = s.frame.views[f.view];
  const auto list = [&](const Span& tiles, int line, const Cells& met) {
    const auto first = view.first_tile + static_cast<std::uint32_t>(line * view.tiles_x);
    for (int k = tiles.first; k < tiles.first + tiles.count; ++k) {
      put(first + static_cast<std::uint32_t>(k), met_of(met, k));
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
        put(first + static_cast<std::uint32_t>(2 * k), met_of(own.met, k));
      }
    }
  }
}

// Where the splats of a chunk begin.
__device__ std::uint32_t chunk_begin(std::uint32_t chunk) {
  const std::uint32_t near = min(chunk, kNearChunks);
  return near * kNearSplats + (chunk - near) * kListSplats;
}

// Brings the chunk's splats and tells how many rows they have. The whole block calls it, as what
// follows.
template <int kRowPixels>
__device__ std::uint32_t load_chunk(ListShared& s, const Workspace& w, std::uint32_t visible) {
  const std::uint32_t rank = chunk_begin(s.chunk) + threadIdx.x;
  Footprint own{};
  if (rank < min(visible, chunk_begin(s.chunk + 1))) {
    const std::uint32_t ordered = w.depth_order[0][rank];
    const std::uint32_t splat = ordered & (kMaxSplats - 1);
    const auto view = static_cast<int>(ordered >> kSplatBits);
    s.splats[threadIdx.x] = splat;
    own = footprint_of<kRowPixels>(splat_of(load_quad(w.splats, splat)), view, s.frame.views[view]);
    s.footprints[threadIdx.x] = own;
  }
  std::uint32_t rows;
  s.row_begin[threadIdx.x] =
      block_sum_before<kWarps>(static_cast<std::uint32_t>(own.rows), s.sums, rows);
  __syncthreads();
  return rows;
}

// How many tiles and squares the chunk lists: fewer than 2^31, of 256 splats in 2^22 tiles of a
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

// Calls put(place, tile, splat, met) for each: `place` counts on through the chunk, `splat` is its
// place there.
template <bool kFovea, typename Put>
__device__ void for_each_tile(ListShared& s, std::uint32_t rows, Put put) {
  std::uint32_t begin = 0;
  for (std::uint32_t first = 0; first < rows; first += kThreads) {
    const std::uint32_t number = first + threadIdx.x;
    RowTiles own{};
    if (number < rows) own = tiles_of_row<kFovea>(s, number, false);
    std::uint32_t total;
    std::uint32_t place = begin + block_sum_before<kWarps>(own.count(), s.sums, total);
    begin += total;
    if (own.count() == 0) continue;
    list_row<kFovea>(s, own, [&](std::uint32_t tile, std::uint32_t met) {
      put(place++, tile, own.row.splat, met);
    });
  }
}

// Writes the chunk's instances from the place `before`.
template <bool kFovea>
__device__ void list_chunk(ListShared& s, const Workspace& w, std::uint32_t rows,
                           std::uint32_t total, std::uint32_t before) {
  const auto write = [&](std::uint32_t to, std::uint32_t tile, std::uint32_t splat,
                         std::uint32_t met) {
    w.tile_keys[0][to] = tile;
    w.tile_splats[0][to] = s.splats[splat] | met << kSplatBits;
    for (int p = 0; p < w.tile_passes; ++p) atomicAdd(&s.digits[p][tile >> 8 * p & 0xFFu], 1u);
  };
  if (total > kStage) {
    for_each_tile<kFovea>(s, rows,
                          [&](std::uint32_t place, std::uint32_t tile, std::uint32_t splat,
                              std::uint32_t met) { write(before + place, tile, splat, met); });
    return;
  }
  for_each_tile<kFovea>(
      s, rows,
      [&](std::uint32_t place, std::uint32_t tile, std::uint32_t splat, std::uint32_t met) {
        s.stage[place] = tile << 8 | splat;
        s.stage_met[place] = static_cast<std::uint8_t>(met);
      });
  __syncthreads();
  for (std::uint32_t k = threadIdx.x; k < total; k += kThreads) {
    write(before + k, s.stage[k] >> 8, s.stage[k] & 0xFFu, s.stage_met[k]);
  }
}

template <bool kFovea>
__global__ void __launch_bounds__(kThreads) list_tiles(const FrameInput* input, const Workspace w) {
  constexpr int kRowPixels = kFovea ? math::kFoveaSquare : kTilePixels;
  __shared__ ListShared s;
  load_frame(input, s.frame);
  for (int p = 0; p < kMostPasses; ++p) s.digits[p][threadIdx.x] = 0;
  const std::uint32_t visible = w.counters->splats;
  for (;;) {
    if (threadIdx.x == 0) s.chunk = atomicAdd(&w.counters->list_ticket, 1u);
    __syncthreads();
    if (chunk_begin(s.chunk) >= visible) break;
    const std::uint32_t rows = load_chunk<kRowPixels>(s, w, visible);
    const std::uint32_t total = count_tiles<kFovea>(s, rows);
    if (threadIdx.x < 32) {
      const Told found = sum_before(w.list_told, s.chunk, total);
      if (threadIdx.x == 0) {
        s.before = found;
        if (chunk_begin(s.chunk + 1) >= visible) {
          const Told all = found + total;
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
