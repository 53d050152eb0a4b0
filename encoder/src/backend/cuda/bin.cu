// SPDX-License-Identifier: Apache-2.0
// Tile lists: visible primitives are sorted by depth once, each then lists the tiles that its
// ellipse meets, and a stable sort by tile of those instances keeps each tile's list in depth
// order.
//
// The number of instances is known on the device alone. The sort by tile runs over a bound that the
// host takes from recent steps, padded with instances of no tile: two passes over a quarter more
// entries cost less than waiting for the count. Every order here is fixed by depth, primitive and
// tile, none by scheduling.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kBlock = 128;
constexpr int kDepthBits = 31;  // depths are positive; kInvisible comes last in these bits too
// Tiles of a box that one thread goes through alone; larger boxes are shared by its warp.
constexpr int kAlone = 12;

struct TileBox {
  int x0, y0, columns, count;
};

// Tiles of the box of a splat: those of the pixels whose centres lie in it.
__device__ TileBox tile_box(const ScreenSplat& s, const View& view) {
  const float w = view.camera.width, h = view.camera.height;
  const int x0 = static_cast<int>(ceilf(fminf(fmaxf(s.x - s.extent_x - 0.5f, 0.0f), w)));
  const int y0 = static_cast<int>(ceilf(fminf(fmaxf(s.y - s.extent_y - 0.5f, 0.0f), h)));
  const int x1 = static_cast<int>(fminf(fmaxf(s.x + s.extent_x + 0.5f, 0.0f), w));
  const int y1 = static_cast<int>(fminf(fmaxf(s.y + s.extent_y + 0.5f, 0.0f), h));
  if (x0 >= x1 || y0 >= y1) return {0, 0, 1, 0};
  const int tx0 = x0 / kTile, ty0 = y0 / kTile;
  const int columns = (x1 - 1) / kTile - tx0 + 1, rows = (y1 - 1) / kTile - ty0 + 1;
  return {tx0, ty0, columns, columns * rows};
}

__device__ bool meets_tile(const ScreenSplat& s, int tx, int ty, const View& view) {
  const int x0 = tx * kTile, y0 = ty * kTile;
  const int x1 = min(x0 + kTile, view.width), y1 = min(y0 + kTile, view.height);
  return ellipse_meets(s, static_cast<float>(x0) + 0.5f, static_cast<float>(x1) - 0.5f,
                       static_cast<float>(y0) + 0.5f, static_cast<float>(y1) - 0.5f);
}

__device__ bool is_large(const TileBox& box) {
  return box.count > kAlone;
}

// Calls visit(k, tx, ty) for each tile of a box that is not large, k counting from 0.
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
  out.x = __shfl_sync(kAllLanes, s.x, lane);
  out.y = __shfl_sync(kAllLanes, s.y, lane);
  out.half_xx = __shfl_sync(kAllLanes, s.half_xx, lane);
  out.cross = __shfl_sync(kAllLanes, s.cross, lane);
  out.half_yy = __shfl_sync(kAllLanes, s.half_yy, lane);
  out.most = __shfl_sync(kAllLanes, s.most, lane);
  return out;
}

__device__ TileBox shuffle_box(const TileBox& b, int lane) {
  return {__shfl_sync(kAllLanes, b.x0, lane), __shfl_sync(kAllLanes, b.y0, lane),
          __shfl_sync(kAllLanes, b.columns, lane), __shfl_sync(kAllLanes, b.count, lane)};
}

// What a lane of the walk below works on; count 0: nothing.
struct Walker {
  ScreenSplat splat;
  TileBox box;
  std::uint32_t primitive, begin;
};

// Calls visit(primitive, begin, tile, place) for each tile that the lanes' splats with a large box
// meet; `place` counts the tiles of a splat from 0, in ascending order of the tiles. Returns the
// lane's own count. All lanes of the warp call it.
template <typename Visit>
__device__ std::uint32_t for_large(const Walker& own, const View& view, Visit visit) {
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
      const bool met = k < box.count && meets_tile(splat, tx, ty, view);
      const unsigned mask = __ballot_sync(kAllLanes, met);
      if (met)
        visit(primitive, begin, static_cast<std::uint32_t>(ty * view.tiles_x + tx),
              found + __popc(mask & ((1u << lane) - 1u)));
      found += __popc(mask);
    }
    if (lane == owner) count = found;
  }
  return count;
}

// The walker of the r-th primitive by depth; idle where there is none.
__device__ Walker walker_of(std::uint32_t r, std::uint32_t n, const View& view,
                            const Workspace& w) {
  Walker walker{};
  walker.box.columns = 1;
  if (r >= n || r >= w.counters->visible) return walker;
  walker.primitive = w.order[r];
  walker.splat = load_splat(w.splats, walker.primitive);
  walker.box = tile_box(walker.splat, view);
  return walker;
}

__global__ void __launch_bounds__(kBlock)
    count_tiles(std::uint32_t n, const View view, const Workspace w) {
  const std::uint32_t r = blockIdx.x * kBlock + threadIdx.x;
  const Walker walker = walker_of(r, n, view, w);
  std::uint32_t mask = 0;  // bit k: the k-th tile of a box that is not large
  for_small(walker.box, [&](int k, int tx, int ty) {
    mask |= static_cast<std::uint32_t>(meets_tile(walker.splat, tx, ty, view)) << k;
  });
  const auto none = [](std::uint32_t, std::uint32_t, std::uint32_t, std::uint32_t) {};
  const std::uint32_t count = __popc(mask) + for_large(walker, view, none);
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
  // Another block may be setting the flag to what this one finds anyway.
  const bool fits = total <= bound && w.counters->overflow == 0;
  if (r == 0 && total > bound) w.counters->overflow = 1;
  for (std::uint32_t k = (fits ? static_cast<std::uint32_t>(total) : 0u) + r; k < bound;
       k += gridDim.x * kBlock)
    w.instance_tiles[k] = 0xFFFFFFFFu;
  if (!fits) return;
  Walker walker = walker_of(r, n, view, w);
  if (walker.box.count > 0) walker.begin = w.tile_offsets[r];
  const auto list = [&](std::uint32_t primitive, std::uint32_t begin, std::uint32_t tile,
                        std::uint32_t place) {
    w.instance_tiles[begin + place] = tile;
    w.owners[begin + place] = primitive;
  };
  const std::uint32_t mask = walker.box.count > 0 ? w.tile_masks[r] : 0;
  std::uint32_t count = 0;
  for_small(walker.box, [&](int k, int tx, int ty) {
    if (mask >> k & 1u)
      list(walker.primitive, walker.begin, static_cast<std::uint32_t>(ty * view.tiles_x + tx),
           count++);
  });
  count += for_large(walker, view, list);
  if (r < n && r < w.counters->visible)
    w.ranges[walker.primitive] = make_uint2(walker.begin, count);
}

// list and tile_begin from the sorted instances.
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
  sum_before(w, w.tile_counts, w.tile_offsets, n, stream);
  list_instances<<<blocks_of(n, kBlock), kBlock, 0, stream>>>(n, view,
                                                              static_cast<std::uint32_t>(bound), w);
  // The padding's low bits are all set, and beyond every tile.
  sort_indices(w, w.instance_tiles, w.tiles_sorted, w.instances_sorted, bound, bits_of(tiles),
               stream);
  const std::size_t threads = bound > tiles + 1 ? bound : tiles + 1;
  make_lists<<<blocks_of(threads, kBlock), kBlock, 0, stream>>>(
      tiles, static_cast<std::uint32_t>(bound), w);
}

}  // namespace stgs::encoder::cuda
