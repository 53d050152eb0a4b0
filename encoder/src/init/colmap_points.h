// SPDX-License-Identifier: Apache-2.0
// Sparse points from COLMAP, which runs as a program of its own with the cameras' known poses.
#pragma once

#include <atomic>
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
// No points are no error: the pictures may share no features. Setting `abandoned`, from any thread,
// ends it soon. Errors: COLMAP fails (with its own last error line), takes more than `seconds` in
// one step, is abandoned, or writes something unreadable.
Result<std::vector<SurfacePoint>> colmap_points(const PreparedCapture& capture, int most_views,
                                                bool masked, int seconds,
                                                const std::atomic<bool>& abandoned);

}  // namespace stgs::encoder::init
