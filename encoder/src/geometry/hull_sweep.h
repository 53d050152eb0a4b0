// SPDX-License-Identifier: Apache-2.0
// Depth of the dynamic content of a frame on a GPU: plane sweeps that are confined to the visual
// hull. The reference on the CPU is init/hull_depth.h.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "geometry/hull_rule.h"
#include "geometry/sweep_mapping.h"
#include "stgs/format/status.h"

namespace stgs::encoder::geometry {

// All pointers are of host memory and outlive the sweep.
struct HullSilhouette {
  SweepCamera camera;
  const float* hiding = nullptr;  // width x height, as VotingView::hiding
};
struct HullImage {
  SweepCamera camera;
  const std::uint32_t* corners = nullptr;  // width x height, as StereoImage::corners; null: unused
};

struct HullBox {
  int x = 0, y = 0, width = 0, height = 0;  // pixels
};

// A reference whose depth is wanted inside of a mask.
struct HullReference {
  int image = 0;
  std::vector<int> sources;            // images, 1 to kSweepSources
  const std::uint8_t* mask = nullptr;  // of the size of the image, 0: no depth is wanted
  std::vector<HullBox> boxes;          // parts of the image that are swept; they do not overlap
  // Results, of the size of the image. They must have depth 0 and cost 1, which remain where no
  // depth is found.
  float* depth = nullptr;  // scene units
  float* cost = nullptr;   // in [0, 1]
  double step = 0;         // largest step in inverse depth between planes
};

// The sweeps of a frame.
struct HullSweep {
  double nearest = 0, farthest = 0;  // depths between which content is sought, above 0
  std::vector<HullSilhouette> silhouettes;
  std::vector<HullImage> images;
  std::vector<HullReference> references;
  // Returns the number of planes of a sweep of a reference, 2 to kMaxHullPlanes.
  std::function<int(int reference, double nearest, double farthest)> planes;
};

class HullSweeper {
 public:
  virtual ~HullSweeper() = default;
  // Fills the results. Thread-safe: several frames are swept at a time. kRuntime if the GPU fails.
  virtual Status run(HullSweep& sweep) = 0;
};

// On GPU number `gpu` modulo the number of GPUs. kNotBuilt without CUDA, kUnsupported without one.
Result<std::unique_ptr<HullSweeper>> make_cuda_hull_sweeper(int gpu);

}  // namespace stgs::encoder::geometry
