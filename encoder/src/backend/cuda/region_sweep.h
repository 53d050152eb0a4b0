// SPDX-License-Identifier: Apache-2.0
// The kernels of plane sweeps of parts of images: costs (geometry/plane_sweep.h), their paths
// (geometry/path_costs.h) and depths. All pointers are of device memory. Nothing here waits; check
// cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "geometry/plane_sweep.h"
#include "geometry/sweep_cost.h"

namespace stgs::encoder::cuda {

// An image that a region is swept against.
struct RegionSource {
  geometry::SweepSource image;
  geometry::SweepMapping mapping;  // of the region
};

// A part of a reference that is swept against sources.
struct SweepRegion {
  geometry::SweepSource reference;
  RegionSource sources[geometry::kSweepSources];
  int source_count;
  int x, y, width, height;
  int planes;  // plane k has the inverse depth farthest_inverse + k * step
  double farthest_inverse, step;
  std::size_t volume;  // the first entry in the volume; the planes of a pixel are contiguous
  std::size_t pixels;  // the first entry in the results
};

// The depth of a pixel, scene units, and its cost in [0, 1]; 0 and 1 without a possible plane.
struct RegionDepth {
  float depth, cost;
};

// Regions that are swept together.
struct SweepRegions {
  const SweepRegion* regions;
  int count;
  int max_width, max_height, max_planes, max_tiles;  // over all regions
  std::size_t max_pixels;
  std::uint8_t* costs;   // the volume
  std::uint16_t* sums;   // of path costs; zero before launch_sweep_paths()
  RegionDepth* results;  // per pixel
};

inline constexpr int kSweepTile = 16;  // pixels, width and height

// Sets the costs that are not kImpossible to those of the planes.
void launch_sweep_costs(const SweepRegions& regions, cudaStream_t stream);

// Adds the costs of the paths in four directions to the sums.
void launch_sweep_paths(const SweepRegions& regions, cudaStream_t stream);

// Writes the depth and the cost of the cheapest plane of each pixel.
void launch_sweep_depths(const SweepRegions& regions, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
