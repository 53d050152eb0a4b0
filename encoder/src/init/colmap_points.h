// SPDX-License-Identifier: Apache-2.0
// Sparse points from COLMAP, which runs as a program of its own with the cameras' known poses.
#pragma once

#include <vector>

#include "init/cover.h"
#include "init/motion.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Whether the program `colmap` is in the PATH.
bool colmap_installed();

// Triangulates the features of frame 0 outside the motion masks, from at most `most_views` training
// views spread over the rig (the time grows with their square). Works in a folder of its own under
// capture.folder, which it removes. One thread each, so that equal input gives equal points.
// Errors: COLMAP fails, takes more than `seconds` in one step, or writes something unreadable.
Result<std::vector<SurfacePoint>> colmap_points(const PreparedCapture& capture, int most_views,
                                                bool masked, int seconds);

}  // namespace stgs::encoder::init
