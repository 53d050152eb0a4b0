// SPDX-License-Identifier: Apache-2.0
// The kernels of velocities from nearest neighbours (geometry/velocity_rule.h). All pointers are of
// device memory. Nothing here waits; check cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "geometry/velocity_rule.h"

namespace stgs::encoder::cuda {

// The points of a frame and those of the frame that they are matched with.
struct MatchedClouds {
  const geometry::MatchPoint* from;
  const geometry::MatchPoint* to;
  int from_count, to_count;
  std::size_t first;  // of the points of `from`, in the arrays below
};

// The pairs of frames of a problem.
struct VelocityArrays {
  const MatchedClouds* pairs;
  int count;
  std::size_t points, max_points;  // of `from`: of all pairs, and of the largest
  float reach;                     // scene units
  // The neighbours within reach of each point, among its kWideNeighbours nearest: neighbour k of
  // point i is at k * points + i, an index into `from`.
  std::uint32_t* neighbours;
  std::uint8_t* neighbour_counts;
  math::Vec3* matched;  // steps of a round before they are smoothed, scene units; NaN: unknown
  math::Vec3* steps;    // and afterwards
};

// Finds the neighbours.
void launch_velocity_neighbours(const VelocityArrays& arrays, cudaStream_t stream);

// Updates the steps, which the first round (0) sets.
void launch_velocity_round(const VelocityArrays& arrays, int round, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
