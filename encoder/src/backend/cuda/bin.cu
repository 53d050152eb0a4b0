// SPDX-License-Identifier: Apache-2.0
// Builds the tile lists:
// 1. Count the tiles that each visible primitive's ellipse intersects: its instances.
// 2. Sum the counts over the tiles.
// 3. List the instances by tile, in any order.
// 4. Sort each tile's instances by depth; ties: lower primitive first.
//
// Few small kernels, because at training sizes each takes about as long as its start. Only the
// device knows the number of instances; the host provides a bound. The lists depend on depth,
// primitive and tile only. The numbers of instances depend on scheduling, but a primitive's are
// consecutive and ordered by tile, so that sums over them do not.
//
// Steps 1 and 3 share the tiles of a block's bounding boxes evenly among its threads: a few
// primitives have hundreds of times as many as others.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kBlock = 256, kWarps = kBlock / 32;
constexpr int kScanBlock = 1024;
constexpr int kSortBlock = 128;
// Entries of a tile that are sorted in shared memory; longer lists are sorted where they are.
constexpr std::uint32_t kMaxSharedEntries = 2048;
// Steps of a sort over at most so many entries stay within a warp.
constexpr std::uint32_t kWarpEntries = 64;

struct TileBox {
  int x0, y0, columns, count;
};

// Returns the tiles of the pixels whose centres lie in the bounding box of a splat.
__device__ TileBox tile_box(const ScreenSplat& s, const View& view) {
  const float w = view.camera.width, h = view.camera.height;
  const int x0 = static_cast<int>(ceilf(fminf(fmaxf(s.mean.x - s.extent.x - 0.5f, 0.0f), w)));
  const int y0 = static_cast<int>(ceilf(fminf(fmaxf(s.mean.y - s.extent.y - 0.5f, 0.0f), h)));
  const int x1 = static_cast<int>(fminf(fmaxf(s.mean.x + s.extent.x + 0.5f, 0.0f), w));
  const int y1 = static_cast<int>(fminf(fmaxf(s.mean.y + s.extent.y + 0.5f, 0.0f), h));
  if (x0 >= x1 || y0 >= y1) return {0, 0, 1, 0};
  const int tx0 = x0 / kTile, ty0 = y0 / kTile;
  const int columns = (x1 - 1) / kTile - tx0 + 1, rows = (y1 - 1) / kTile - ty0 + 1;
  return {tx0, ty0, columns, columns * rows};
}

__device__ bool hits_tile(const ScreenSplat& s, int tx, int ty, const View& view) {
  const int x0 = tx * kTile, y0 = ty * kTile;
  const int x1 = min(x0 + kTile, view.width), y1 = min(y0 + kTile, view.height);
  return ellipse_meets(s, static_cast<float>(x0) + 0.5f, static_cast<float>(x1) - 0.5f,
                       static_cast<float>(y0) + 0.5f, static_cast<float>(y1) - 0.5f);
}

// Returns the sum over the lanes up to this one.
__device__ std::uint32_t warp_sum_up_to(std::uint32_t value) {
  const int lane = threadIdx.x & 31;
#pragma unroll
  for (int step = 1; step < 32; step *= 2) {
    const std::uint32_t before = __shfl_up_sync(kAllLanes, value, step);
    if (lane >= step) value += before;
  }
  return value;
}

// The primitives of a block, and the tiles of their bounding boxes, one after the other.
struct Candidates {
  ScreenSplat splats[kBinPrimitives];
  TileBox boxes[kBinPrimitives];
  std::uint32_t begin[kBinPrimitives];  // first tile of a primitive's box
  std::uint32_t hits[kBinPrimitives];   // tiles that it intersects
  std::uint32_t count;                  // of all tiles
};

// Returns the number of the block's primitive k.
__device__ std::uint32_t primitive_of(std::uint32_t k) {
  return blockIdx.x * kBinPrimitives + k;
}

// Fills the candidates, with hits of 0. All threads call it.
__device__ void load_candidates(std::uint32_t n, const View& view, const Workspace& w,
                                Candidates& c) {
  static_assert(kBinPrimitives == 64, "two warps load them");
  const std::uint32_t k = threadIdx.x, i = primitive_of(k);
  std::uint32_t end = 0;
  if (k < kBinPrimitives) {
    TileBox box{0, 0, 1, 0};
    if (i < n && w.depth_keys[i] != kInvisible) {
      c.splats[k] = load_splat(w.splats, i);
      box = tile_box(c.splats[k], view);
    }
    c.boxes[k] = box;
    c.hits[k] = 0;
    end = warp_sum_up_to(static_cast<std::uint32_t>(box.count));
    if (k == 31) c.count = end;
  }
  __syncthreads();
  const std::uint32_t before = k < 32 ? 0 : c.count;
  if (k < kBinPrimitives) c.begin[k] = before + end - static_cast<std::uint32_t>(c.boxes[k].count);
  __syncthreads();
  if (k == kBinPrimitives - 1) c.count = before + end;
  __syncthreads();
}

// A tile of a box.
struct Candidate {
  std::uint32_t k = 0;  // the block's primitive
  std::uint32_t tile = 0;
  bool hit = false;  // its ellipse intersects the tile
};

__device__ Candidate candidate_at(const Candidates& c, std::uint32_t at, const View& view) {
  Candidate out;
  if (at >= c.count) return out;
#pragma unroll
  for (std::uint32_t step = kBinPrimitives / 2; step > 0; step /= 2)
    if (c.begin[out.k + step] <= at) out.k += step;
  const TileBox box = c.boxes[out.k];
  const int number = static_cast<int>(at - c.begin[out.k]);
  const int tx = box.x0 + number % box.columns, ty = box.y0 + number / box.columns;
  out.tile = static_cast<std::uint32_t>(ty * view.tiles_x + tx);
  out.hit = hits_tile(c.splats[out.k], tx, ty, view);
  return out;
}

__global__ void __launch_bounds__(kBlock)
    count_tiles(std::uint32_t n, const View view, const Workspace w) {
  __shared__ Candidates candidates;
  __shared__ std::uint32_t sum;
  if (threadIdx.x == 0) sum = 0;
  load_candidates(n, view, w, candidates);
  std::uint32_t own = 0;
  for (std::uint32_t at = threadIdx.x; at < candidates.count; at += kBlock) {
    const Candidate c = candidate_at(candidates, at, view);
    if (!c.hit) continue;
    atomicAdd(w.tile_entries + c.tile, 1u);
    ++own;
  }
  own = warp_sum(own);
  if ((threadIdx.x & 31) == 0 && own > 0) atomicAdd(&sum, own);
  __syncthreads();
  if (threadIdx.x == 0)
    w.block_begin[blockIdx.x] = static_cast<std::uint32_t>(
        atomicAdd(&w.counters->instances, static_cast<unsigned long long>(sum)));
}

// Returns the sum over the threads before this one. `total`: of all threads.
__device__ std::uint32_t sum_before(std::uint32_t value, std::uint32_t& total) {
  __shared__ std::uint32_t warps[kScanBlock / 32];
  const int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  const std::uint32_t sum = warp_sum_up_to(value);
  __syncthreads();
  if (lane == 31) warps[warp] = sum;
  __syncthreads();
  std::uint32_t before = 0;
  total = 0;
  for (int v = 0; v < kScanBlock / 32; ++v) {
    if (v == warp) before = total;
    total += warps[v];
  }
  return before + sum - value;
}

// Computes tile_begin, and sets tile_entries to 0. All lists are empty if the instances exceed the
// bound, or those of an earlier step did.
__global__ void __launch_bounds__(kScanBlock)
    sum_tiles(std::uint32_t tiles, std::uint32_t bound, const Workspace w) {
  const bool is_over = w.counters->instances > bound;
  const bool fits = !is_over && w.counters->overflow == 0;
  __syncthreads();
  if (threadIdx.x == 0 && is_over) w.counters->overflow = 1;
  std::uint32_t begin = 0;
  for (std::uint32_t base = 0; base <= tiles; base += kScanBlock) {
    const std::uint32_t tile = base + threadIdx.x;
    std::uint32_t total = 0;
    const std::uint32_t count = fits && tile < tiles ? w.tile_entries[tile] : 0;
    const std::uint32_t before = sum_before(count, total);
    if (tile <= tiles) w.tile_begin[tile] = begin + before;
    if (tile < tiles) w.tile_entries[tile] = 0;
    begin += total;
  }
}

// Writes the ranges of the block's primitives, whose hits are complete. All threads call it.
__device__ void write_ranges(std::uint32_t n, std::uint32_t first, const Candidates& c,
                             const Workspace& w) {
  __shared__ std::uint32_t of_first_warp;
  const std::uint32_t k = threadIdx.x, i = primitive_of(k);
  const std::uint32_t hits = k < kBinPrimitives ? c.hits[k] : 0;
  const std::uint32_t end = warp_sum_up_to(hits);
  if (k == 31) of_first_warp = end;
  __syncthreads();
  if (k < kBinPrimitives && i < n)
    w.ranges[i] = make_uint2(first + (k < 32 ? 0 : of_first_warp) + end - hits, hits);
}

__global__ void __launch_bounds__(kBlock)
    list_instances(std::uint32_t n, const View view, const Workspace w) {
  __shared__ Candidates candidates;
  __shared__ std::uint32_t warps[2][kWarps];  // hits of each warp, of alternate rounds
  if (w.counters->overflow != 0) return;
  load_candidates(n, view, w, candidates);
  const int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  const std::uint32_t first = w.block_begin[blockIdx.x];
  std::uint32_t instance = first;  // of the round's first hit
  for (std::uint32_t base = 0, round = 0; base < candidates.count; base += kBlock, round ^= 1) {
    const Candidate c = candidate_at(candidates, base + threadIdx.x, view);
    const unsigned mask = __ballot_sync(kAllLanes, c.hit);
    if (lane == 0) warps[round][warp] = __popc(mask);
    std::uint32_t at = 0;
    if (c.hit) at = w.tile_begin[c.tile] + atomicAdd(w.tile_entries + c.tile, 1u);
    __syncthreads();
    std::uint32_t own = instance + __popc(mask & ((1u << lane) - 1u));
    for (int v = 0; v < kWarps; ++v) {
      if (v < warp) own += warps[round][v];
      instance += warps[round][v];
    }
    if (!c.hit) continue;
    const std::uint32_t i = primitive_of(c.k);
    atomicAdd(&candidates.hits[c.k], 1u);
    w.entry_keys[at] = static_cast<unsigned long long>(w.depth_keys[i]) << 32 | i;
    w.instances_sorted[at] = own;
  }
  __syncthreads();
  write_ranges(n, first, candidates, w);
}

// The entries of a tile.
struct Entries {
  unsigned long long* keys;  // depth, then primitive
  std::uint32_t* instances;
};

__device__ void put_in_order(const Entries& e, std::uint32_t a, std::uint32_t b) {
  const unsigned long long key_a = e.keys[a], key_b = e.keys[b];
  if (key_a <= key_b) return;
  e.keys[a] = key_b;
  e.keys[b] = key_a;
  const std::uint32_t instance = e.instances[a];
  e.instances[a] = e.instances[b];
  e.instances[b] = instance;
}

// Sorts n entries by a bitonic network whose comparisons are all ascending, so that those beyond n
// can be left out. All threads of the block call it.
__device__ void sort_entries(const Entries& e, std::uint32_t n) {
  std::uint32_t pairs = 1, widest = 0;
  while (2 * pairs < n) pairs *= 2;
  // A step over `span` entries; find(i) returns the lower entry of pair i, and the upper one.
  const auto step = [&](std::uint32_t span, auto find) {
    if (max(span, widest) <= kWarpEntries) {
      __syncwarp();
    } else {
      __syncthreads();
    }
    widest = span;
    for (std::uint32_t i = threadIdx.x; i < pairs; i += kSortBlock) {
      const uint2 pair = find(i);
      if (pair.y < n) put_in_order(e, pair.x, pair.y);
    }
  };
  for (std::uint32_t k = 2; k <= 2 * pairs; k *= 2) {
    step(k, [k](std::uint32_t i) {
      const std::uint32_t base = i / (k / 2) * k, offset = i % (k / 2);
      return make_uint2(base + offset, base + k - 1 - offset);
    });
    for (std::uint32_t j = k / 4; j > 0; j /= 2)
      step(2 * j, [j](std::uint32_t i) {
        const std::uint32_t a = 2 * i - (i & (j - 1));
        return make_uint2(a, a + j);
      });
  }
  __syncthreads();
}

// One block per tile. Also sets tile_entries to 0 again, for the next step.
__global__ void __launch_bounds__(kSortBlock) sort_tiles(const Workspace w) {
  __shared__ unsigned long long keys[kMaxSharedEntries];
  __shared__ std::uint32_t instances[kMaxSharedEntries];
  const std::uint32_t tile = blockIdx.x, first = w.tile_begin[tile];
  const std::uint32_t n = w.tile_begin[tile + 1] - first;
  if (threadIdx.x == 0) w.tile_entries[tile] = 0;
  if (n == 0) return;
  const Entries given{w.entry_keys + first, w.instances_sorted + first};
  const bool is_shared = n <= kMaxSharedEntries;
  const Entries own = is_shared ? Entries{keys, instances} : given;
  for (std::uint32_t k = threadIdx.x; is_shared && k < n; k += kSortBlock) {
    keys[k] = given.keys[k];
    instances[k] = given.instances[k];
  }
  __syncthreads();
  sort_entries(own, n);
  for (std::uint32_t k = threadIdx.x; k < n; k += kSortBlock) {
    w.list[first + k] = static_cast<std::uint32_t>(own.keys[k]);
    if (is_shared) given.instances[k] = instances[k];
  }
}

}  // namespace

void launch_bin(std::uint32_t n, const View& view, std::size_t bound, const Workspace& w,
                cudaStream_t stream) {
  const auto tiles = static_cast<std::uint32_t>(view.tiles_x * view.tiles_y);
  const int blocks = blocks_of(n, kBinPrimitives);
  count_tiles<<<blocks, kBlock, 0, stream>>>(n, view, w);
  sum_tiles<<<1, kScanBlock, 0, stream>>>(tiles, static_cast<std::uint32_t>(bound), w);
  list_instances<<<blocks, kBlock, 0, stream>>>(n, view, w);
  sort_tiles<<<tiles, kSortBlock, 0, stream>>>(w);
}

}  // namespace stgs::encoder::cuda
