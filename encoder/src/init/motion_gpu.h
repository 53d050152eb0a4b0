// SPDX-License-Identifier: Apache-2.0
// Motion detection with the frames of a prepared capture on a GPU.
#pragma once

#include <functional>
#include <vector>

#include "geometry/motion_finder.h"
#include "init/background.h"
#include "init/motion.h"

namespace stgs::encoder::init {

// As find_background().
Result<Background> find_gpu_background(geometry::MotionFinder& gpu, const PreparedCapture& capture,
                                       const View& view, bool use_masks);

// Writes the masks of all frames to the prepared capture, and sets the flow and the coverage.
Status write_gpu_masks(geometry::MotionFinder& gpu, const PreparedCapture& capture,
                       const View& view, const InitSettings& settings, const Background& background,
                       const Work& work, ViewMotion* motion);

// Finds the masks of frames by a background alone, as LiveBackground::mask().
Status find_gpu_masks(geometry::MotionFinder& gpu, const PreparedCapture& capture, const View& view,
                      const Background& background, const std::vector<int>& frames,
                      const Work& work, const MaskSink& take);

// Sets the flow of a frame.
Status find_gpu_flow(geometry::MotionFinder& gpu, const PreparedCapture& capture, const View& view,
                     int frame, ViewMotion* motion);

}  // namespace stgs::encoder::init
