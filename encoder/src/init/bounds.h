// SPDX-License-Identifier: Apache-2.0
// Derives the near plane and the scene bounds from the initial points.
#pragma once

#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// Sets near_plane, extent, scene_centre and scene_radius of `capture` from the points and the
// training views. Keeps the previous values where there is too little data. Points at half of the
// distance `far` of the far background, or beyond, do not count; 0: all do.
void set_bounds(const std::vector<View>& views, std::vector<InitialPoint> points, double far,
                PreparedCapture* capture);

// Removes the points that lie in front of the near plane in any training view.
void drop_too_near(const std::vector<View>& views, float near_plane,
                   std::vector<InitialPoint>* points);

}  // namespace stgs::encoder::init
