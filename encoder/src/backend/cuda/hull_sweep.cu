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
__global__ void __launch_bounds__(256)
    limits_kernel(SweepRegions all, const HullLimit* limits, HullVotes votes) {
  const SweepRegion& region = all.regions[blockIdx.y];
  const HullLimit limit = limits[blockIdx.y];
  const std::uint32_t entry = blockIdx.x * 256 + threadIdx.x;
  const std::uint32_t planes = static_cast<std::uint32_t>(region.planes);
  const int pixel = static_cast<int>(entry / planes), plane = static_cast<int>(entry % planes);
  if (pixel >= region.width * region.height) return;
  const int x = region.x + pixel % region.width, y = region.y + pixel / region.width;
  const float depth = 1.0f / fmaf(static_cast<float>(plane), static_cast<float>(region.step),
                                  static_cast<float>(region.farthest_inverse));
  const bool possible = limit.mask[y * region.reference.width + x] != 0 &&
                        in_hull(votes, votes.rays + limit.rays, static_cast<float>(x) + 0.5f,
                                static_cast<float>(y) + 0.5f, depth);
  all.costs[region.volume + entry] = possible ? 0 : kImpossible;
}

}  // namespace

void launch_hull_spans(const HullSample* samples, int count, const HullVotes& votes,
                       float farthest_inverse, float step, HullSpan* spans, cudaStream_t stream) {
  if (count == 0) return;
  spans_kernel<<<static_cast<unsigned>(count), geometry::kHullDepths, 0, stream>>>(
      samples, votes, farthest_inverse, step, spans);
}

void launch_hull_limits(const SweepRegions& regions, const HullLimit* limits,
                        const HullVotes& votes, cudaStream_t stream) {
  const std::size_t entries = regions.max_pixels * static_cast<std::size_t>(regions.max_planes);
  const dim3 grid(static_cast<unsigned>(blocks_of(entries, 256)),
                  static_cast<unsigned>(regions.count));
  limits_kernel<<<grid, 256, 0, stream>>>(regions, limits, votes);
}

}  // namespace stgs::encoder::cuda
