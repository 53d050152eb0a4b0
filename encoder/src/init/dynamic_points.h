// SPDX-License-Identifier: Apache-2.0
// Points of what moves, a frame: depth sweeps confined to the visual hull.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/motion.h"
#include "init/static_points.h"

namespace stgs::encoder::init {

struct DynamicFrame {
  std::vector<SurfacePoint> points;
  int checked = 0;  // of them: confirmed by another view
  std::size_t hull_cells = 0;
};

struct DynamicSettings {
  int limit = 1000;    // points a frame
  int references = 8;  // views that get a depth map
  int longest = 240;   // pixels of the sweeps
};

// `views` give the working resolution of masks; `scene` must have surfaces of the same cameras.
// Asks `work` between views whether to go on.
Status find_dynamic_points(const PreparedCapture& capture, const std::vector<View>& views,
                           const StaticScene& scene, int frame, const DynamicSettings& settings,
                           const Work& work, DynamicFrame* out);

}  // namespace stgs::encoder::init
