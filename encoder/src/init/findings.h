// SPDX-License-Identifier: Apache-2.0
// The weaknesses of a prepared capture, with their reasons and remedies.
#pragma once

#include <string>
#include <vector>

#include "init/calibration_check.h"
#include "init/static_points.h"
#include "init/timing_check.h"
#include "init/view.h"

namespace stgs::encoder::init {

struct Finding {
  std::string text;  // with the camera, if it concerns one
  std::string remedy;
  bool is_logged = false;  // by the stage that found it
};

// Returns the findings about calibration, timing, masks, overlap, measured depth, exposure and
// sharpness, the most consequential first. `masked`: whether the masks of a view were given.
// `points` are the static points.
std::vector<Finding> find_weaknesses(const std::vector<View>& views, const StaticScene& scene,
                                     const CalibrationCheck& calibration,
                                     const std::vector<LateCamera>& late,
                                     const std::vector<bool>& masked,
                                     const std::vector<SurfacePoint>& points);

}  // namespace stgs::encoder::init
