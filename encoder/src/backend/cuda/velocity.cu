// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/velocity.h"

#include "backend/cuda/kernels.h"

namespace stgs::encoder::cuda {
namespace {

using geometry::kWideNeighbours;
using geometry::MatchPoint;
using geometry::NearestPoints;
using math::Vec3;

constexpr int kBlock = 128;  // points per block, and per tile of the points that are searched

// Finds the nearest of `points` to a query of each thread. All threads of the block call it.
template <int kCount>
__device__ NearestPoints<kCount> nearest_points(const MatchPoint* points, int count,
                                                MatchPoint query, float colour) {
  __shared__ MatchPoint tile[kBlock];
  NearestPoints<kCount> nearest = geometry::no_points<kCount>();
  for (int start = 0; start < count; start += kBlock) {
    const int mine = start + static_cast<int>(threadIdx.x);
    __syncthreads();
    if (mine < count) tile[threadIdx.x] = points[mine];
    __syncthreads();
    const int end = min(kBlock, count - start);
#pragma unroll 4
    for (int k = 0; k < end; ++k)
      geometry::add_point(nearest, geometry::squared_distance(query, tile[k], colour), start + k);
  }
  return nearest;
}

// Returns the squared weight of colours, of which a channel's full range is `reaches` reaches.
float colour_weight(const VelocityArrays& all, double reaches) {
  const double weight = reaches * all.reach / 255;
  return static_cast<float>(weight * weight);
}

// One thread per point of pair blockIdx.y.
__global__ void __launch_bounds__(kBlock) neighbours_kernel(VelocityArrays all, float colour) {
  const MatchedClouds pair = all.pairs[blockIdx.y];
  const int first = static_cast<int>(blockIdx.x) * kBlock;
  if (first >= pair.from_count) return;
  const int i = first + static_cast<int>(threadIdx.x);
  const MatchPoint query = pair.from[min(i, pair.from_count - 1)];
  const auto nearest = nearest_points<kWideNeighbours>(pair.from, pair.from_count, query, colour);
  if (i >= pair.from_count) return;
  const std::size_t at = pair.first + static_cast<std::size_t>(i);
  int count = 0;
#pragma unroll
  for (int k = 0; k < kWideNeighbours; ++k) {
    if (nearest.index[k] < 0 || nearest.squared[k] > all.reach * all.reach) continue;
    all.neighbours[static_cast<std::size_t>(k) * all.points + at] =
        static_cast<std::uint32_t>(nearest.index[k]);
    count = k + 1;
  }
  all.neighbour_counts[at] = static_cast<std::uint8_t>(count);
}

__device__ Vec3 unknown() {
  const float nan = nanf("");
  return {nan, nan, nan};
}

// One thread per point of pair blockIdx.y: the mean of the steps to its nearest points.
__global__ void __launch_bounds__(kBlock)
    match_kernel(VelocityArrays all, float colour, bool has_steps) {
  const MatchedClouds pair = all.pairs[blockIdx.y];
  const int first = static_cast<int>(blockIdx.x) * kBlock;
  if (first >= pair.from_count) return;
  const int i = first + static_cast<int>(threadIdx.x);
  const MatchPoint from = pair.from[min(i, pair.from_count - 1)];
  const std::size_t at = pair.first + static_cast<std::size_t>(i);
  MatchPoint query = from;
  if (has_steps && i < pair.from_count) {
    const Vec3 step = all.steps[at];
    if (step.x == step.x) {
      query.x += step.x;
      query.y += step.y;
      query.z += step.z;
    }
  }
  const auto nearest =
      nearest_points<geometry::kMatchedPoints>(pair.to, pair.to_count, query, colour);
  if (i >= pair.from_count) return;
  Vec3 sum{0.0f, 0.0f, 0.0f};
  float found = 0.0f;
#pragma unroll
  for (int k = 0; k < geometry::kMatchedPoints; ++k) {
    if (nearest.index[k] < 0) continue;
    const MatchPoint to = pair.to[nearest.index[k]];
    const Vec3 step{to.x - from.x, to.y - from.y, to.z - from.z};
    if (step.x * step.x + step.y * step.y + step.z * step.z > all.reach * all.reach) continue;
    sum.x += step.x;
    sum.y += step.y;
    sum.z += step.z;
    found += 1.0f;
  }
  all.matched[at] = found > 0.0f ? Vec3{sum.x / found, sum.y / found, sum.z / found} : unknown();
}

// One thread per point of pair blockIdx.y: the median of the steps of at most `neighbours` points.
__global__ void __launch_bounds__(kBlock) smooth_kernel(VelocityArrays all, int neighbours) {
  const MatchedClouds pair = all.pairs[blockIdx.y];
  const int i = static_cast<int>(blockIdx.x) * kBlock + static_cast<int>(threadIdx.x);
  if (i >= pair.from_count) return;
  const std::size_t at = pair.first + static_cast<std::size_t>(i);
  float x[kWideNeighbours], y[kWideNeighbours], z[kWideNeighbours];
  int known = 0;
  const int count = min(neighbours, static_cast<int>(all.neighbour_counts[at]));
  for (int k = 0; k < count; ++k) {
    const std::uint32_t near = all.neighbours[static_cast<std::size_t>(k) * all.points + at];
    const Vec3 step = all.matched[pair.first + near];
    if (step.x != step.x) continue;
    x[known] = step.x;
    y[known] = step.y;
    z[known] = step.z;
    ++known;
  }
  all.steps[at] = known < geometry::kMinForMedian
                      ? unknown()
                      : Vec3{geometry::median_of(x, known), geometry::median_of(y, known),
                             geometry::median_of(z, known)};
}

dim3 grid_of(const VelocityArrays& arrays) {
  return dim3(static_cast<unsigned>(blocks_of(arrays.max_points, kBlock)),
              static_cast<unsigned>(arrays.count));
}

}  // namespace

void launch_velocity_neighbours(const VelocityArrays& arrays, cudaStream_t stream) {
  neighbours_kernel<<<grid_of(arrays), kBlock, 0, stream>>>(
      arrays, colour_weight(arrays, geometry::kSmoothColour));
}

void launch_velocity_round(const VelocityArrays& arrays, int round, cudaStream_t stream) {
  match_kernel<<<grid_of(arrays), kBlock, 0, stream>>>(
      arrays, colour_weight(arrays, geometry::kMatchColour), round > 0);
  smooth_kernel<<<grid_of(arrays), kBlock, 0, stream>>>(arrays,
                                                        geometry::smoothing_neighbours(round));
}

}  // namespace stgs::encoder::cuda
