// SPDX-License-Identifier: Apache-2.0
// The kernels that confine plane sweeps to the visual hull (geometry/hull_sweep.h). All pointers
// are of device memory. Nothing here waits; check cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "backend/cuda/region_sweep.h"
#include "geometry/hull_rule.h"
#include "geometry/stereo_problem.h"

namespace stgs::encoder::cuda {

// A silhouette as seen from the pixels of a reference: the point at `depth` of the ray through
// (u, v) is at depth * along (u, v, 1) + start in the silhouette's camera space.
struct HullRay {
  geometry::Mat3 along;
  geometry::Vec3 start;
  const float* hiding;
  int width, height;
  float fx, fy, cx, cy;
};

// A pixel whose ray is sampled for the depths of a box.
struct HullSample {
  int box, rays;  // `rays`: index of the first HullRay of its reference
  float u, v;
};

// The first and last sampled depth at which rays meet the hull, counted from the farthest.
struct HullSpan {
  int first, last;  // first > last: none
};

// The silhouettes that points are tested against.
struct HullVotes {
  const HullRay* rays;  // `views` for each reference
  int views;
  float nearest;  // content is not nearer to a view, scene units
};

// Where a region can have depth.
struct HullLimit {
  const std::uint8_t* mask;  // of the reference
  int rays;                  // as in HullSample
};

// Widens the spans of the boxes of the samples by the depths k in [0, kHullDepths) with the inverse
// depth farthest_inverse + k * step.
void launch_hull_spans(const HullSample* samples, int count, const HullVotes& votes,
                       float farthest_inverse, float step, HullSpan* spans, cudaStream_t stream);

// Sets the costs of the regions, each with its limit, to 0 inside of the hull and the mask, and to
// kImpossible elsewhere.
void launch_hull_limits(const SweepRegions& regions, const HullLimit* limits,
                        const HullVotes& votes, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
