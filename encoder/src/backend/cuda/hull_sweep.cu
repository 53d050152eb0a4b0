// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/hull_sweep.h"

#include "backend/cuda/device.cuh"
#include "geometry/hull_rule.h"
#include "geometry/sweep_rule.h"

namespace stgs::encoder::cuda {
namespace {

using geometry::kImpossible;
using geometry::Mat3;
using geometry::Vec3;
using math::kAllLanes;

constexpr int kReach = geometry::kSweepWindow / 2;  // pixels
constexpr int kPatchSide = kHullTile + 2 * kReach;  // of the tile with the windows around it
constexpr int kPatch = kPatchSide * kPatchSide;
constexpr int kPlanesPerBlock = 8;
constexpr int kLinesPerBlock = 4;  // warps
constexpr int kNoPath = 0xffff;    // of a plane beyond the last

__device__ Vec3 times(const Mat3& m, float u, float v) {
  return {fmaf(m.xx, u, fmaf(m.xy, v, m.xz)), fmaf(m.yx, u, fmaf(m.yy, v, m.yz)),
          fmaf(m.zx, u, fmaf(m.zy, v, m.zz))};
}

// Whether a point of a ray through (u, v) is in the hull. `rays`: of the reference.
__device__ bool in_hull(const HullVotes& votes, const HullRay* rays, float u, float v,
                        float depth) {
  int inside = 0, outside = 0;
  for (int k = 0; k < votes.views; ++k) {
    const HullRay& ray = rays[k];
    const Vec3 along = times(ray.along, u, v);
    const float z = fmaf(along.z, depth, ray.start.z);
    if (z < votes.nearest) continue;
    const float unit = 1.0f / z;
    const float px = fmaf(fmaf(along.x, depth, ray.start.x) * unit, ray.fx, ray.cx);
    const float py = fmaf(fmaf(along.y, depth, ray.start.y) * unit, ray.fy, ray.cy);
    if (!(px >= 0.0f && py >= 0.0f && px < static_cast<float>(ray.width) &&
          py < static_cast<float>(ray.height)))
      continue;
    const float hiding = ray.hiding[static_cast<int>(py) * ray.width + static_cast<int>(px)];
    if (z > fabsf(hiding)) continue;
    if (hiding < 0.0f)
      ++inside;
    else
      ++outside;
  }
  return geometry::is_in_hull(inside, outside, votes.views);
}

// One block per sample, one thread per depth.
__global__ void __launch_bounds__(geometry::kHullDepths)
    spans_kernel(const HullSample* samples, HullVotes votes, float farthest_inverse, float step,
                 HullSpan* spans) {
  const HullSample sample = samples[blockIdx.x];
  const int k = static_cast<int>(threadIdx.x);
  const float depth = 1.0f / fmaf(static_cast<float>(k), step, farthest_inverse);
  if (!in_hull(votes, votes.rays + sample.rays, sample.u, sample.v, depth)) return;
  atomicMin(&spans[sample.box].first, k);
  atomicMax(&spans[sample.box].last, k);
}

// One thread per entry of the volume of region blockIdx.y.
__global__ void __launch_bounds__(256) limits_kernel(HullRegions all, HullVotes votes) {
  const HullRegion& region = all.regions[blockIdx.y];
  const std::uint32_t entry = blockIdx.x * 256 + threadIdx.x;
  const std::uint32_t planes = static_cast<std::uint32_t>(region.planes);
  const int pixel = static_cast<int>(entry / planes), plane = static_cast<int>(entry % planes);
  if (pixel >= region.width * region.height) return;
  const int x = region.x + pixel % region.width, y = region.y + pixel / region.width;
  const float depth = 1.0f / fmaf(static_cast<float>(plane), region.step, region.farthest_inverse);
  const bool possible = region.mask[y * region.reference.width + x] != 0 &&
                        in_hull(votes, votes.rays + region.rays, static_cast<float>(x) + 0.5f,
                                static_cast<float>(y) + 0.5f, depth);
  all.costs[region.volume + entry] = possible ? 0 : kImpossible;
}

// A position in a source, in indices of pixels.
struct Position {
  float x, y;
  bool seen;
};

__device__ Position position_in(const geometry::StereoImage& source, const Mat3& h, float u,
                                float v) {
  const Vec3 p = times(h, u, v);
  const float unit = 1.0f / fmaxf(p.z, 1e-9f);
  const float x = p.x * unit - 0.5f, y = p.y * unit - 0.5f;
  const bool seen = p.z > 0.0f && x >= -0.5f && y >= -0.5f &&
                    x < static_cast<float>(source.width) - 0.5f &&
                    y < static_cast<float>(source.height) - 0.5f;
  return {x, y, seen};
}

// Bilinear grey value, clamped to the image.
__device__ float grey_between(const geometry::StereoImage& image, Position at) {
  const float x = fminf(fmaxf(at.x, 0.0f), static_cast<float>(image.width - 1));
  const float y = fminf(fmaxf(at.y, 0.0f), static_cast<float>(image.height - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const std::uint32_t corners = image.corners[y0 * image.width + x0];
  const auto corner = [&](int k) { return static_cast<float>(corners >> (8 * k) & 0xFFu); };
  const float above = fmaf(ax, corner(1) - corner(0), corner(0));
  const float below = fmaf(ax, corner(3) - corner(2), corner(2));
  return fmaf(ay, below - above, above);
}

// Grey values of a tile and the windows around it. Beyond the region, its border continues.
struct Patch {
  float values[kPatch];
};

// The pixel of the reference at entry i of the patch of a tile.
__device__ int2 patch_pixel(const HullRegion& region, int2 tile, int i) {
  const int x = min(max(tile.x + i % kPatchSide - kReach, 0), region.width - 1);
  const int y = min(max(tile.y + i / kPatchSide - kReach, 0), region.height - 1);
  return make_int2(region.x + x, region.y + y);
}

struct Means {
  float a, b, aa, bb, ab;  // of the windows in the two patches, and of products
};

__device__ Means means_of(const Patch& a, const Patch& b, int x, int y) {
  Means sums{};
  for (int dy = 0; dy < geometry::kSweepWindow; ++dy) {
    for (int dx = 0; dx < geometry::kSweepWindow; ++dx) {
      const int at = (y + dy) * kPatchSide + x + dx;
      const float p = a.values[at], q = b.values[at];
      sums.a += p;
      sums.b += q;
      sums.aa = fmaf(p, p, sums.aa);
      sums.bb = fmaf(q, q, sums.bb);
      sums.ab = fmaf(p, q, sums.ab);
    }
  }
  constexpr float kShare = 1.0f / (geometry::kSweepWindow * geometry::kSweepWindow);
  return {sums.a * kShare, sums.b * kShare, sums.aa * kShare, sums.bb * kShare, sums.ab * kShare};
}

// The cost of geometry/plane_sweep.h between the centres p and q of two windows.
__device__ float cost_of(const Means& m, float p, float q) {
  const float variance_a = fmaxf(m.aa - m.a * m.a, 0.0f) + geometry::kSweepTextureFloor;
  const float variance_b = fmaxf(m.bb - m.b * m.b, 0.0f) + geometry::kSweepTextureFloor;
  const float correlation = (m.ab - m.a * m.b) * rsqrtf(variance_a * variance_b);
  const float colour = 0.5f / geometry::kColourScale * (fabsf(m.a - m.b) + fabsf(p - q));
  const float cost = (1.0f - geometry::kColourShare) * fminf(1.0f, 1.0f - correlation) +
                     geometry::kColourShare * fminf(1.0f, colour);
  return fminf(fmaxf(cost, 0.0f), 1.0f);
}

// One block per tile and kPlanesPerBlock planes of region blockIdx.y.
__global__ void __launch_bounds__(kHullTile* kHullTile) costs_kernel(HullRegions all) {
  __shared__ Patch reference, source;
  const HullRegion& region = all.regions[blockIdx.y];
  const int tiles_x = (region.width + kHullTile - 1) / kHullTile;
  const int tiles_y = (region.height + kHullTile - 1) / kHullTile;
  const int tile_index = static_cast<int>(blockIdx.x);
  if (tile_index >= tiles_x * tiles_y) return;
  const int2 tile = make_int2(tile_index % tiles_x * kHullTile, tile_index / tiles_x * kHullTile);
  const int thread = static_cast<int>(threadIdx.x);
  const int tx = thread % kHullTile, ty = thread / kHullTile;
  const int x = tile.x + tx, y = tile.y + ty;
  const bool in_region = x < region.width && y < region.height;
  for (int i = thread; i < kPatch; i += kHullTile * kHullTile) {
    const int2 p = patch_pixel(region, tile, i);
    reference.values[i] = geometry::grey_at(region.reference, p.x, p.y);
  }
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
    const Vec3 row = {0.0f, 0.0f,
                      fmaf(static_cast<float>(plane), region.step, region.farthest_inverse)};
    float first = 1.0f, second = 1.0f, seen = 0.0f;
    for (int s = 0; s < region.source_count; ++s) {
      const geometry::StereoImage& image = region.sources[s].image;
      const Mat3 h = geometry::plane_homography(region.sources[s], row);
      __syncthreads();
      for (int i = thread; i < kPatch; i += kHullTile * kHullTile) {
        const int2 p = patch_pixel(region, tile, i);
        source.values[i] = grey_between(image, position_in(image, h, p.x + 0.5f, p.y + 0.5f));
      }
      __syncthreads();
      if (cost == nullptr || !position_in(image, h, region.x + x + 0.5f, region.y + y + 0.5f).seen)
        continue;
      const int middle = (ty + kReach) * kPatchSide + tx + kReach;
      const float value = cost_of(means_of(reference, source, tx, ty), reference.values[middle],
                                  source.values[middle]);
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

// The path costs of two planes per lane: `low` of plane `lane`, `high` of plane 32 + lane.
struct PathCosts {
  int low, high;
};

// Returns the smallest path cost of the neighbouring planes of each plane.
__device__ PathCosts neighbours_of(PathCosts from, int lane) {
  const int low_before = __shfl_up_sync(kAllLanes, from.low, 1);
  const int low_after = __shfl_down_sync(kAllLanes, from.low, 1);
  const int high_before = __shfl_up_sync(kAllLanes, from.high, 1);
  const int high_after = __shfl_down_sync(kAllLanes, from.high, 1);
  const int last_low = __shfl_sync(kAllLanes, from.low, 31);
  const int first_high = __shfl_sync(kAllLanes, from.high, 0);
  return {min(lane == 0 ? kNoPath : low_before, lane == 31 ? first_high : low_after),
          min(lane == 0 ? last_low : high_before, lane == 31 ? kNoPath : high_after)};
}

// One warp per line of region blockIdx.y. Paths go in direction (dx, dy).
__global__ void __launch_bounds__(32 * kLinesPerBlock)
    paths_kernel(HullRegions all, int dx, int dy) {
  const HullRegion& region = all.regions[blockIdx.y];
  const int lines = dx != 0 ? region.height : region.width;
  const int length = dx != 0 ? region.width : region.height;
  const int line = static_cast<int>(blockIdx.x) * kLinesPerBlock + static_cast<int>(threadIdx.y);
  if (line >= lines) return;
  const int lane = static_cast<int>(threadIdx.x), planes = region.planes;
  const bool has_low = lane < planes, has_high = lane + 32 < planes;
  PathCosts from{kNoPath, kNoPath};
  int base = 0;
  float grey_before = 0.0f;
  for (int i = 0; i < length; ++i) {
    const int along = dx + dy < 0 ? length - 1 - i : i;
    const int x = dx != 0 ? along : line, y = dx != 0 ? line : along;
    const std::size_t entry = region.volume + static_cast<std::size_t>(y * region.width + x) *
                                                  static_cast<std::size_t>(planes);
    const float grey = geometry::grey_at(region.reference, region.x + x, region.y + y);
    PathCosts out{kNoPath, kNoPath};
    if (has_low) out.low = all.costs[entry + lane];
    if (has_high) out.high = all.costs[entry + lane + 32];
    if (i > 0) {
      const int jump = base + geometry::large_step(fabsf(grey - grey_before));
      const PathCosts side = neighbours_of(from, lane);
      if (has_low) out.low += min(min(from.low, side.low + geometry::kSmallStep), jump) - base;
      if (has_high) out.high += min(min(from.high, side.high + geometry::kSmallStep), jump) - base;
    }
    if (has_low)
      all.sums[entry + lane] = static_cast<std::uint16_t>(all.sums[entry + lane] + out.low);
    if (has_high)
      all.sums[entry + lane + 32] =
          static_cast<std::uint16_t>(all.sums[entry + lane + 32] + out.high);
    base = warp_min(min(out.low, out.high));
    from = out;
    grey_before = grey;
  }
}

// One thread per pixel of region blockIdx.y.
__global__ void __launch_bounds__(256) depths_kernel(HullRegions all) {
  const HullRegion& region = all.regions[blockIdx.y];
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
  HullDepth& result = all.results[region.pixels + pixel];
  if (cost == kImpossible) {
    result = {0.0f, 1.0f};
    return;
  }
  float at = static_cast<float>(best);
  if (best > 0 && best + 1 < planes)
    at += geometry::parabola_offset(sums[best - 1], sums[best], sums[best + 1]);
  result = {1.0f / fmaf(at, region.step, region.farthest_inverse),
            static_cast<float>(cost) / 254.0f};
}

unsigned region_count(const HullRegions& regions) {
  return static_cast<unsigned>(regions.count);
}

}  // namespace

void launch_hull_spans(const HullSample* samples, int count, const HullVotes& votes,
                       float farthest_inverse, float step, HullSpan* spans, cudaStream_t stream) {
  if (count == 0) return;
  spans_kernel<<<static_cast<unsigned>(count), geometry::kHullDepths, 0, stream>>>(
      samples, votes, farthest_inverse, step, spans);
}

void launch_hull_limits(const HullRegions& regions, const HullVotes& votes, cudaStream_t stream) {
  const std::size_t entries = regions.most_pixels * static_cast<std::size_t>(regions.most_planes);
  limits_kernel<<<dim3(blocks_of(entries, 256), region_count(regions)), 256, 0, stream>>>(regions,
                                                                                          votes);
}

void launch_hull_costs(const HullRegions& regions, cudaStream_t stream) {
  const dim3 grid(static_cast<unsigned>(regions.most_tiles), region_count(regions),
                  blocks_of(static_cast<std::size_t>(regions.most_planes), kPlanesPerBlock));
  costs_kernel<<<grid, kHullTile * kHullTile, 0, stream>>>(regions);
}

void launch_hull_paths(const HullRegions& regions, cudaStream_t stream) {
  for (const int step : {1, -1}) {
    const dim3 block(32, kLinesPerBlock);
    const auto grid = [&](int lines) {
      return dim3(blocks_of(static_cast<std::size_t>(lines), kLinesPerBlock),
                  region_count(regions));
    };
    paths_kernel<<<grid(regions.highest), block, 0, stream>>>(regions, step, 0);
    paths_kernel<<<grid(regions.widest), block, 0, stream>>>(regions, 0, step);
  }
}

void launch_hull_depths(const HullRegions& regions, cudaStream_t stream) {
  depths_kernel<<<dim3(blocks_of(regions.most_pixels, 256), region_count(regions)), 256, 0,
                  stream>>>(regions);
}

}  // namespace stgs::encoder::cuda
