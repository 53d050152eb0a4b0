// SPDX-License-Identifier: Apache-2.0
// Builds the tile lists:
// 1. Sort the visible primitives by depth, once.
// 2. List the tiles that each primitive's ellipse intersects: its instances.
// 3. Sort the instances by tile. The sort is stable, so each tile's list remains in depth order.
//
// Only the device knows the number of instances. The sort by tile therefore covers an upper bound
// that the host derives from recent steps, padded with instances of no tile: two passes over a
// quarter more entries cost less than waiting for the count. All orders depend on depth, primitive
// and tile only, never on scheduling.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kBlock = 128;
constexpr int kDepthBits = 31;  // depths are positive; kInvisible sorts last in these bits too
// Maximum tiles of a box that a single thread processes; its warp shares larger boxes.
constexpr int kMaxTilesPerThread = 12;

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

__device__ bool is_large(const TileBox& box) {
  return box.count > kMaxTilesPerThread;
}

// Calls visit(k, tx, ty) for the k-th tile of a box that is not large.
template <typename Visit>
__device__ void for_small(const TileBox& box, Visit visit) {
  if (is_large(box)) return;
  int tx = box.x0, ty = box.y0;
  for (int k = 0; k < box.count; ++k) {
    visit(k, tx, ty);
    if (++tx == box.x0 + box.columns) {
      tx = box.x0;
      ++ty;
    }
  }
}

__device__ ScreenSplat shuffle_splat(const ScreenSplat& s, int lane) {
  ScreenSplat out = s;
  out.mean.x = __shfl_sync(kAllLanes, s.mean.x, lane);
  out.mean.y = __shfl_sync(kAllLanes, s.mean.y, lane);
  out.falloff.xx = __shfl_sync(kAllLanes, s.falloff.xx, lane);
  out.falloff.xy = __shfl_sync(kAllLanes, s.falloff.xy, lane);
  out.falloff.yy = __shfl_sync(kAllLanes, s.falloff.yy, lane);
  out.peak = __shfl_sync(kAllLanes, s.peak, lane);
  return out;
}

__device__ TileBox shuffle_box(const TileBox& b, int lane) {
  return {__shfl_sync(kAllLanes, b.x0, lane), __shfl_sync(kAllLanes, b.y0, lane),
          __shfl_sync(kAllLanes, b.columns, lane), __shfl_sync(kAllLanes, b.count, lane)};
}

// The primitive of a lane; idle if box.count is 0.
struct TileWalk {
  ScreenSplat splat;
  TileBox box;
  std::uint32_t primitive, begin;
};

// Calls visit(primitive, begin, tile, index) for each tile that the lanes' splats with a large box
// intersect; `index` counts the tiles of a splat in ascending order. Returns the lane's own count.
// All lanes of the warp must call it.
template <typename Visit>
__device__ std::uint32_t for_large(const TileWalk& own, const View& view, Visit visit) {
  const int lane = threadIdx.x & 31;
  std::uint32_t count = 0;
  unsigned large = __ballot_sync(kAllLanes, is_large(own.box));
  while (large != 0) {
    const int owner = __ffs(large) - 1;
    large &= large - 1;
    const ScreenSplat splat = shuffle_splat(own.splat, owner);
    const TileBox box = shuffle_box(own.box, owner);
    const std::uint32_t primitive = __shfl_sync(kAllLanes, own.primitive, owner);
    const std::uint32_t begin = __shfl_sync(kAllLanes, own.begin, owner);
    std::uint32_t found = 0;
    for (int k = lane; k - lane < box.count; k += 32) {
      const int tx = box.x0 + k % box.columns, ty = box.y0 + k / box.columns;
      const bool hit = k < box.count && hits_tile(splat, tx, ty, view);
      const unsigned mask = __ballot_sync(kAllLanes, hit);
      if (hit)
        visit(primitive, begin, static_cast<std::uint32_t>(ty * view.tiles_x + tx),
              found + __popc(mask & ((1u << lane) - 1u)));
      found += __popc(mask);
    }
    if (lane == owner) count = found;
  }
  return count;
}

// Returns the walk of the r-th primitive by depth; idle if there is none.
__device__ TileWalk walk_of(std::uint32_t r, std::uint32_t n, const View& view,
                            const Workspace& w) {
  TileWalk walk{};
  walk.box.columns = 1;
  if (r >= n || r >= w.counters->visible) return walk;
  walk.primitive = w.order[r];
  walk.splat = load_splat(w.splats, walk.primitive);
  walk.box = tile_box(walk.splat, view);
  return walk;
}

__global__ void __launch_bounds__(kBlock)
    count_tiles(std::uint32_t n, const View view, const Workspace w) {
  const std::uint32_t r = blockIdx.x * kBlock + threadIdx.x;
  const TileWalk walk = walk_of(r, n, view, w);
  std::uint32_t mask = 0;  // bit k: the k-th tile of a box that is not large
  for_small(walk.box, [&](int k, int tx, int ty) {
    mask |= static_cast<std::uint32_t>(hits_tile(walk.splat, tx, ty, view)) << k;
  });
  const auto none = [](std::uint32_t, std::uint32_t, std::uint32_t, std::uint32_t) {};
  const std::uint32_t count = __popc(mask) + for_large(walk, view, none);
  if (r < n) w.tile_masks[r] = mask;
  if (r < n) w.tile_counts[r] = count;
  const std::uint32_t sum = warp_sum(count);
  if ((threadIdx.x & 31) == 0 && sum > 0)
    atomicAdd(&w.counters->instances, static_cast<unsigned long long>(sum));
}

__global__ void __launch_bounds__(kBlock)
    list_instances(std::uint32_t n, const View view, std::uint32_t bound, const Workspace w) {
  const std::uint32_t r = blockIdx.x * kBlock + threadIdx.x;
  const unsigned long long total = w.counters->instances;
  // A race with another block that sets the flag is benign: both find the same.
  const bool fits = total <= bound && w.counters->overflow == 0;
  if (r == 0 && total > bound) w.counters->overflow = 1;
  for (std::uint32_t k = (fits ? static_cast<std::uint32_t>(total) : 0u) + r; k < bound;
       k += gridDim.x * kBlock)
    w.instance_tiles[k] = 0xFFFFFFFFu;
  if (!fits) return;
  TileWalk walk = walk_of(r, n, view, w);
  if (walk.box.count > 0) walk.begin = w.tile_offsets[r];
  const auto list = [&](std::uint32_t primitive, std::uint32_t begin, std::uint32_t tile,
                        std::uint32_t index) {
    w.instance_tiles[begin + index] = tile;
    w.owners[begin + index] = primitive;
  };
  const std::uint32_t mask = walk.box.count > 0 ? w.tile_masks[r] : 0;
  std::uint32_t count = 0;
  for_small(walk.box, [&](int k, int tx, int ty) {
    if (mask >> k & 1u)
      list(walk.primitive, walk.begin, static_cast<std::uint32_t>(ty * view.tiles_x + tx), count++);
  });
  count += for_large(walk, view, list);
  if (r < n && r < w.counters->visible) w.ranges[walk.primitive] = make_uint2(walk.begin, count);
}

// Computes list and tile_begin from the sorted instances.
__global__ void __launch_bounds__(kBlock)
    make_lists(std::uint32_t tiles, std::uint32_t bound, const Workspace w) {
  const std::uint32_t k = blockIdx.x * kBlock + threadIdx.x;
  if (k < bound && w.tiles_sorted[k] < tiles) w.list[k] = w.owners[w.instances_sorted[k]];
  if (k > tiles) return;
  std::uint32_t low = 0, high = bound;  // the first entry of tile k or a later one
  while (low < high) {
    const std::uint32_t middle = (low + high) / 2;
    if (w.tiles_sorted[middle] < k) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  w.tile_begin[k] = low;
}

int bits_of(std::uint32_t x) {
  int bits = 0;
  for (; x != 0; x >>= 1) ++bits;
  return bits;
}

}  // namespace

void launch_bin(std::uint32_t n, const View& view, std::size_t bound, const Workspace& w,
                cudaStream_t stream) {
  const std::uint32_t tiles = static_cast<std::uint32_t>(view.tiles_x * view.tiles_y);
  sort_indices(w, w.depth_keys, w.depth_sorted, w.order, n, kDepthBits, stream);
  count_tiles<<<blocks_of(n, kBlock), kBlock, 0, stream>>>(n, view, w);
  exclusive_sum(w, w.tile_counts, w.tile_offsets, n, stream);
  list_instances<<<blocks_of(n, kBlock), kBlock, 0, stream>>>(n, view,
                                                              static_cast<std::uint32_t>(bound), w);
  // The low bits of the padding are all set, so it sorts after every tile.
  sort_indices(w, w.instance_tiles, w.tiles_sorted, w.instances_sorted, bound, bits_of(tiles),
               stream);
  const std::size_t threads = bound > tiles + 1 ? bound : tiles + 1;
  make_lists<<<blocks_of(threads, kBlock), kBlock, 0, stream>>>(
      tiles, static_cast<std::uint32_t>(bound), w);
}

}  // namespace stgs::encoder::cuda
