// SPDX-License-Identifier: Apache-2.0
// Finds points on dynamic content, per frame: depth sweeps confined to the visual hull.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/motion.h"
#include "init/static_points.h"

namespace stgs::encoder::init {

struct DynamicFrame {
  std::vector<SurfacePoint> points;
  int checked = 0;  // points confirmed by another view
  std::size_t hull_cells = 0;
};

struct DynamicSettings {
  int limit = 1000;    // points per frame
  int references = 8;  // number of views with a depth map
  int max_side = 240;  // longer side of the sweeps, pixels
};

// Finds the dynamic points of one frame. `views` set the working resolution of the masks; `scene`
// must have surfaces of the same cameras. Leaves `out` empty if fewer than two views show motion.
// Checks `work` for cancellation between views.
Status find_dynamic_points(const PreparedCapture& capture, const std::vector<View>& views,
                           const StaticScene& scene, int frame, const DynamicSettings& settings,
                           const Work& work, DynamicFrame* out);

}  // namespace stgs::encoder::init
