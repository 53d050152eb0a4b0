// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/region_sweep.h"

#include "backend/cuda/device.cuh"
#include "geometry/sweep_rule.h"

namespace stgs::encoder::cuda {
namespace {

using geometry::kImpossible;
using math::kAllLanes;

constexpr int kReach = geometry::kSweepWindow / 2;   // pixels
constexpr int kPatchSide = kSweepTile + 2 * kReach;  // of the tile with the windows around it
constexpr int kPatch = kPatchSide * kPatchSide;
constexpr int kPlanesPerBlock = 8;
constexpr int kLinesPerBlock = 4;  // warps
constexpr int kMaxPlanesPerLane = geometry::kMaxSweepPlanes / 32;
constexpr int kNoPath = 0xffff;  // of a plane beyond the last

// Grey values of a tile and the windows around it. Beyond the region, its border continues.
struct Patch {
  float values[kPatch];
};

// The pixel of the region at entry i of the patch of a tile.
__device__ int2 patch_pixel(const SweepRegion& region, int2 tile, int i) {
  const int x = min(max(tile.x + i % kPatchSide - kReach, 0), region.width - 1);
  const int y = min(max(tile.y + i / kPatchSide - kReach, 0), region.height - 1);
  return make_int2(x, y);
}

// The grey value of a pixel of the reference.
__device__ float reference_grey(const SweepRegion& region, int x, int y) {
  return static_cast<float>(region.reference.corners[y * region.reference.width + x] & 0xFFu);
}

// One block per tile and kPlanesPerBlock planes of region blockIdx.y.
__global__ void __launch_bounds__(kSweepTile* kSweepTile) costs_kernel(SweepRegions all) {
  __shared__ Patch reference, warped;
  __shared__ float last[3];  // column of the homography
  const SweepRegion& region = all.regions[blockIdx.y];
  const int tiles_x = (region.width + kSweepTile - 1) / kSweepTile;
  const int tiles_y = (region.height + kSweepTile - 1) / kSweepTile;
  const int tile_index = static_cast<int>(blockIdx.x);
  if (tile_index >= tiles_x * tiles_y) return;
  const int2 tile = make_int2(tile_index % tiles_x * kSweepTile, tile_index / tiles_x * kSweepTile);
  const int thread = static_cast<int>(threadIdx.x);
  const int tx = thread % kSweepTile, ty = thread / kSweepTile;
  const int x = tile.x + tx, y = tile.y + ty;
  const bool in_region = x < region.width && y < region.height;
  for (int i = thread; i < kPatch; i += kSweepTile * kSweepTile) {
    const int2 p = patch_pixel(region, tile, i);
    reference.values[i] = reference_grey(region, region.x + p.x, region.y + p.y);
  }
  __syncthreads();
  // The first entry of the window, and the middle.
  const int corner = ty * kPatchSide + tx, middle = corner + kReach * kPatchSide + kReach;
  const float* own = reference.values + corner;
  const geometry::WindowSums means = geometry::window_means(own, own, kPatchSide);
  const geometry::ReferenceWindow window{reference.values[middle], means.value,
                                         geometry::variance_of(means)};
  const int first_plane = static_cast<int>(blockIdx.z) * kPlanesPerBlock;
  const int end_plane = min(first_plane + kPlanesPerBlock, region.planes);
  for (int plane = first_plane; plane < end_plane; ++plane) {
    std::uint8_t* cost = nullptr;
    if (in_region) {
      cost =
          all.costs + region.volume +
          static_cast<std::size_t>(y * region.width + x) * static_cast<std::size_t>(region.planes) +
          plane;
      if (*cost == kImpossible) cost = nullptr;
    }
    if (!__syncthreads_or(cost != nullptr)) continue;
    float first = 1.0f, second = 1.0f, seen = 0.0f;
    for (int s = 0; s < region.source_count; ++s) {
      const geometry::SweepSource& image = region.sources[s].image;
      const geometry::SweepMapping& mapping = region.sources[s].mapping;
      const auto position = [&](int px, int py) {
        return geometry::sweep_position(mapping, last, image.width, image.height,
                                        static_cast<float>(px), static_cast<float>(py));
      };
      __syncthreads();
      if (thread < 3)
        last[thread] =
            geometry::last_column(mapping, thread, region.farthest_inverse + plane * region.step);
      __syncthreads();
      for (int i = thread; i < kPatch; i += kSweepTile * kSweepTile) {
        const int2 p = patch_pixel(region, tile, i);
        warped.values[i] =
            geometry::grey_between(image.corners, image.width, image.height, position(p.x, p.y));
      }
      __syncthreads();
      if (cost == nullptr) continue;
      const geometry::SweepPosition at = position(x, y);
      if (!at.seen || !geometry::is_usable(image.usable, image.width, image.height, at)) continue;
      const float value =
          geometry::sweep_cost(window, warped.values[middle],
                               geometry::window_means(warped.values + corner, own, kPatchSide));
      second = fminf(second, fmaxf(first, value));
      first = fminf(first, value);
      seen += 1.0f;
    }
    if (cost != nullptr) *cost = geometry::volume_cost(first, second, seen);
  }
}

__device__ int warp_min(int value) {
  for (int width = 16; width > 0; width /= 2)
    value = min(value, __shfl_xor_sync(kAllLanes, value, width));
  return value;
}

// The path costs of the planes of a lane: lane, 32 + lane, and so on.
template <int kPerLane>
struct PathCosts {
  int of[kPerLane];
};

template <int kPerLane>
__device__ PathCosts<kPerLane> no_paths() {
  PathCosts<kPerLane> out;
  for (int& cost : out.of) cost = kNoPath;
  return out;
}

// Returns the smallest path cost of the neighbouring planes of each plane.
template <int kPerLane>
__device__ PathCosts<kPerLane> neighbours_of(PathCosts<kPerLane> from, int lane) {
  PathCosts<kPerLane> out;
#pragma unroll
  for (int k = 0; k < kPerLane; ++k) {
    int before = __shfl_up_sync(kAllLanes, from.of[k], 1);
    int after = __shfl_down_sync(kAllLanes, from.of[k], 1);
    const int last = k > 0 ? __shfl_sync(kAllLanes, from.of[max(k - 1, 0)], 31) : kNoPath;
    const int first =
        k + 1 < kPerLane ? __shfl_sync(kAllLanes, from.of[min(k + 1, kPerLane - 1)], 0) : kNoPath;
    if (lane == 0) before = last;
    if (lane == 31) after = first;
    out.of[k] = min(before, after);
  }
  return out;
}

// One warp per line of region blockIdx.y. Paths go in direction (dx, dy).
template <int kPerLane>
__global__ void __launch_bounds__(32 * kLinesPerBlock)
    paths_kernel(SweepRegions all, int dx, int dy) {
  const SweepRegion& region = all.regions[blockIdx.y];
  const int lines = dx != 0 ? region.height : region.width;
  const int length = dx != 0 ? region.width : region.height;
  const int line = static_cast<int>(blockIdx.x) * kLinesPerBlock + static_cast<int>(threadIdx.y);
  if (line >= lines) return;
  const int lane = static_cast<int>(threadIdx.x), planes = region.planes;
  PathCosts<kPerLane> from = no_paths<kPerLane>();
  int base = 0;
  float grey_before = 0.0f;
  for (int i = 0; i < length; ++i) {
    const int along = dx + dy < 0 ? length - 1 - i : i;
    const int x = dx != 0 ? along : line, y = dx != 0 ? line : along;
    const std::size_t entry = region.volume + static_cast<std::size_t>(y * region.width + x) *
                                                  static_cast<std::size_t>(planes);
    const float grey = reference_grey(region, region.x + x, region.y + y);
    const int jump = base + geometry::large_step(fabsf(grey - grey_before));
    const PathCosts<kPerLane> side = neighbours_of(from, lane);
    PathCosts<kPerLane> out = no_paths<kPerLane>();
    int lowest = kNoPath;
#pragma unroll
    for (int k = 0; k < kPerLane; ++k) {
      const int plane = 32 * k + lane;
      if (plane >= planes) continue;
      out.of[k] = all.costs[entry + plane];
      if (i > 0) out.of[k] += min(min(from.of[k], side.of[k] + geometry::kSmallStep), jump) - base;
      std::uint16_t& sum = all.sums[entry + plane];
      sum = static_cast<std::uint16_t>(sum + out.of[k]);
      lowest = min(lowest, out.of[k]);
    }
    base = warp_min(lowest);
    from = out;
    grey_before = grey;
  }
}

// One thread per pixel of region blockIdx.y.
__global__ void __launch_bounds__(256) depths_kernel(SweepRegions all) {
  const SweepRegion& region = all.regions[blockIdx.y];
  const int pixel = static_cast<int>(blockIdx.x * 256 + threadIdx.x);
  if (pixel >= region.width * region.height) return;
  const int planes = region.planes;
  const std::size_t entry =
      region.volume + static_cast<std::size_t>(pixel) * static_cast<std::size_t>(planes);
  const std::uint16_t* sums = all.sums + entry;
  int best = 0;
  for (int plane = 1; plane < planes; ++plane)
    if (sums[plane] < sums[best]) best = plane;
  const std::uint8_t cost = all.costs[entry + best];
  RegionDepth& result = all.results[region.pixels + pixel];
  if (cost == kImpossible) {
    result = {0.0f, 1.0f};
    return;
  }
  double at = best;
  if (best > 0 && best + 1 < planes)
    at += geometry::parabola_offset(sums[best - 1], sums[best], sums[best + 1]);
  result = {static_cast<float>(1.0 / (region.farthest_inverse + at * region.step)),
            static_cast<float>(cost) / 254.0f};
}

unsigned region_count(const SweepRegions& regions) {
  return static_cast<unsigned>(regions.count);
}

}  // namespace

void launch_sweep_costs(const SweepRegions& regions, cudaStream_t stream) {
  const dim3 grid(static_cast<unsigned>(regions.max_tiles), region_count(regions),
                  blocks_of(static_cast<std::size_t>(regions.max_planes), kPlanesPerBlock));
  costs_kernel<<<grid, kSweepTile * kSweepTile, 0, stream>>>(regions);
}

void launch_sweep_paths(const SweepRegions& regions, cudaStream_t stream) {
  const auto kernel = regions.max_planes <= 64 ? paths_kernel<2> : paths_kernel<kMaxPlanesPerLane>;
  const auto launch = [&](int lines, int dx, int dy) {
    const dim3 grid(
        static_cast<unsigned>(blocks_of(static_cast<std::size_t>(lines), kLinesPerBlock)),
        region_count(regions));
    kernel<<<grid, dim3(32, kLinesPerBlock), 0, stream>>>(regions, dx, dy);
  };
  for (const int step : {1, -1}) {
    launch(regions.max_height, step, 0);
    launch(regions.max_width, 0, step);
  }
}

void launch_sweep_depths(const SweepRegions& regions, cudaStream_t stream) {
  depths_kernel<<<dim3(blocks_of(regions.max_pixels, 256), region_count(regions)), 256, 0,
                  stream>>>(regions);
}

}  // namespace stgs::encoder::cuda
