// SPDX-License-Identifier: Apache-2.0
// The scene's measures, from its initial points.
#pragma once

#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// Sets near_plane, extent, scene_centre and scene_radius from the points and training cameras.
void set_bounds(const std::vector<View>& views, const std::vector<InitialPoint>& points,
                PreparedCapture* capture);

// Drops the points that some training camera sees nearer than the near plane.
void drop_too_near(const std::vector<View>& views, float near_plane,
                   std::vector<InitialPoint>* points);

}  // namespace stgs::encoder::init
