// SPDX-License-Identifier: Apache-2.0
// Triangulates sparse points by running COLMAP with the known camera poses.
#pragma once

#include <atomic>
#include <vector>

#include "init/cover.h"
#include "init/motion.h"
#include "init/view.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Returns true if the program `colmap` is in PATH.
bool colmap_installed();

// Triangulates the features of frame 0 outside the motion masks (if `masked`). Uses at most
// `max_views` of the views, spread over the rig, because the time grows with their square. Works
// in a temporary folder below capture.folder. Runs COLMAP on one thread to limit variation between
// runs. Returns no points if the images share no features.
// Setting `abandoned` from any thread ends the call soon. kRuntime if COLMAP fails (with its last
// error line), takes more than `seconds` in one step, is abandoned or writes unreadable output.
Result<std::vector<SurfacePoint>> colmap_points(const PreparedCapture& capture,
                                                const std::vector<View>& views, int max_views,
                                                bool masked, int seconds,
                                                const std::atomic<bool>& abandoned);

}  // namespace stgs::encoder::init
