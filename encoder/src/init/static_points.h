// SPDX-License-Identifier: Apache-2.0
// The static start: depth of the median backgrounds, fused into points that cover every view.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/depth_sweep.h"
#include "init/init.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Depths at which the training cameras see anything, scene units.
struct DepthRange {
  double nearest = 0, farthest = 0;
  bool measured = false;  // false: guessed from the cameras alone
};

// One view's picture and what of it may be used (8-bit, 255; empty: all).
struct Still {
  View view;
  cv::Mat rgb, usable;
};

struct StaticScene {
  DepthRange range;
  Focus focus;
  std::vector<Surface> surfaces;  // a view: depth is dense, weight is above 0 where it was checked
  std::vector<cv::Mat> usable;    // a view, 8-bit: 255 where the still has a colour
  std::vector<SurfacePoint> points;
  int swept = 0, sparse = 0, filled = 0;  // points by origin
};

// Coarse sweeps of the given stills (several a view allowed, grouped: stills[k][view]).
Status find_depth_range(const std::vector<std::vector<Still>>& stills, Work& work,
                        StaticScene* scene);

// Dense depth of every still, checked across views; holes filled from their surroundings.
Status find_static_depth(const std::vector<Still>& stills, Work& work, StaticScene* scene);

// At most `limit` points: `sparse` first, then checked depth, then filled depth.
void choose_static_points(const std::vector<SurfacePoint>& sparse, int limit, StaticScene* scene);

// Planes so that neighbouring ones are about a pixel apart in the neighbours, within limits.
int plane_count(const View& view, const std::vector<View>& views, const std::vector<int>& others,
                double nearest, double farthest, int low, int high);

}  // namespace stgs::encoder::init
