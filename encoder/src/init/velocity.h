// SPDX-License-Identifier: Apache-2.0
// Velocities of dynamic points: the paper's nearest neighbours in the adjacent frame, and optical
// flow of several views lifted to 3D. Which one serves is measured.
#pragma once

#include <vector>

#include "init/dynamic_points.h"
#include "init/motion.h"

namespace stgs::encoder::init {

using Velocities = std::vector<cv::Vec3d>;  // a point, scene units a frame; NaN: unknown

// Displacement to the nearest points of `next` in position and colour, smoothed by the median over
// neighbouring points of the frame; unknown where nothing within `reach` scene units matches.
// `sign` is -1 where `next` is really the previous frame.
Velocities match_velocities(const std::vector<SurfacePoint>& points,
                            const std::vector<SurfacePoint>& next, double reach, double sign);

// The velocity whose projections agree best with the flow of the views that see the point;
// unknown where fewer than two views have flow for it. `frame` indexes ViewMotion::flow.
Velocities flow_velocities(const std::vector<SurfacePoint>& points, const std::vector<View>& views,
                           const std::vector<ViewMotion>& motion, int frame, double reach);

// `first`, where that is unknown `second`, where both are 0.
Velocities settled(const Velocities& first, const Velocities& second);

// How well points moved by their velocities fit the next frame.
struct MotionFit {
  double inside = 0;  // share of the projections that fall inside the next masks
  double colour = 0;  // mean absolute difference to the next pictures, grey levels
  long samples = 0;
  // Smaller is better: a projection outside the masks counts as a difference of 64 levels.
  double badness() const { return samples == 0 ? 1e9 : colour + 64 * (1 - inside); }
};
Result<MotionFit> measure_motion(const PreparedCapture& capture, const std::vector<View>& views,
                                 const std::vector<SurfacePoint>& points,
                                 const Velocities& velocities, int next_frame);

}  // namespace stgs::encoder::init
