// SPDX-License-Identifier: Apache-2.0
// Finds points on dynamic content, per frame: depth sweeps confined to the visual hull.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/hull_depth.h"
#include "init/motion.h"
#include "init/static_points.h"

namespace stgs::encoder::init {

struct DynamicFrame {
  std::vector<SurfacePoint> points;
  int checked = 0;  // points confirmed by another view
};

// Longer side of the sweeps, pixels. On the CPU there are still 20 pixels per point.
inline constexpr int kCpuSweepSide = 160, kGpuSweepSide = 240;

struct DynamicSettings {
  int limit = 1000;              // points per frame
  int references = 8;            // number of views with a depth map
  int max_side = kCpuSweepSide;  // of the sweeps
  int hull_side = 320;           // of the masks whose visual hull confines them
};

class DynamicFinder {
 public:
  // `scene` has the surfaces of `views`, in the same order.
  // `gpu`: of the sweeps; null for the CPU. Keeps references to the capture, the scene and the GPU.
  DynamicFinder(const PreparedCapture& capture, const std::vector<View>& views,
                const StaticScene& scene, const DynamicSettings& settings,
                geometry::HullSweeper* gpu);

  // Finds the points of one frame. Leaves `out` empty if fewer than two views show motion. Checks
  // `work` for cancellation between views. Thread-safe.
  Status find(int frame, const Work& work, DynamicFrame* out) const;

 private:
  Status load_silhouettes(int frame, std::vector<Silhouette>* out) const;
  Status sweep_references(int frame, const DynamicHull& hull, const Work& work,
                          DynamicFrame* out) const;

  const PreparedCapture& capture_;
  const StaticScene& scene_;
  DynamicSettings settings_;
  geometry::HullSweeper* gpu_;
  std::vector<View> hull_, small_;  // of the masks and of the sweeps
  std::vector<cv::Mat> hiding_;     // per view: the depth that its static surface hides
  DepthInterval limits_;            // dynamic content may be nearer than any static content
  std::vector<int> references_;
  std::vector<std::vector<int>> partners_;  // of each small view
};

}  // namespace stgs::encoder::init
