// SPDX-License-Identifier: Apache-2.0
// The kernels of plane sweeps within the visual hull (geometry/hull_sweep.h). All pointers are of
// device memory. Nothing here waits; check cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

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

// A box that is swept.
struct HullRegion {
  geometry::StereoImage reference;
  geometry::StereoSource sources[geometry::kHullSources];
  int source_count;
  const std::uint8_t* mask;  // of the reference
  int x, y, width, height;
  int rays;    // as in HullSample
  int planes;  // plane k has the inverse depth farthest_inverse + k * step
  float farthest_inverse, step;
  std::size_t volume;  // the first entry in the volume; the planes of a pixel are contiguous
  std::size_t pixels;  // the first entry in the results
};

// The depth of a pixel, scene units, and its cost in [0, 1]; 0 and 1 without a possible plane.
struct HullDepth {
  float depth, cost;
};

// The regions of a frame.
struct HullRegions {
  const HullRegion* regions;
  int count;
  int widest, highest, most_planes, most_tiles;  // over all regions
  std::size_t most_pixels;
  std::uint8_t* costs;  // the volume
  std::uint16_t* sums;  // of path costs; zero before launch_hull_paths()
  HullDepth* results;   // per pixel
};

inline constexpr int kHullTile = 16;  // pixels, width and height

// Widens the spans of the boxes of the samples by the depths k in [0, kHullDepths) with the inverse
// depth farthest_inverse + k * step.
void launch_hull_spans(const HullSample* samples, int count, const HullVotes& votes,
                       float farthest_inverse, float step, HullSpan* spans, cudaStream_t stream);

// Sets the costs to 0 inside of the hull and the mask, and to kImpossible elsewhere.
void launch_hull_limits(const HullRegions& regions, const HullVotes& votes, cudaStream_t stream);

// Sets the costs that are not kImpossible to those of the planes.
void launch_hull_costs(const HullRegions& regions, cudaStream_t stream);

// Adds the costs of the paths in four directions to the sums.
void launch_hull_paths(const HullRegions& regions, cudaStream_t stream);

// Writes the depth and the cost of the cheapest plane of each pixel.
void launch_hull_depths(const HullRegions& regions, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
