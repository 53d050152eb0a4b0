// SPDX-License-Identifier: Apache-2.0
// Estimates velocities of dynamic points in two ways: nearest neighbours in the adjacent frame
// (velocity_match.h), and optical flow of several views lifted to 3D. A measurement selects one.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "geometry/velocity_matcher.h"
#include "init/dynamic_points.h"
#include "init/motion.h"
#include "init/motion_fit.h"
#include "init/work.h"

namespace stgs::encoder::init {

// Returns the velocities whose projections agree best with the flow of the views that see the
// points. Unknown where fewer than two views have flow, or beyond `reach` scene units per frame.
// `frame` indexes ViewMotion::flow.
Velocities flow_velocities(const std::vector<SurfacePoint>& points, const std::vector<View>& views,
                           const std::vector<ViewMotion>& motion, int frame, double reach);

// Returns velocities for the last frame, which has no flow. Each point takes the velocity of the
// nearest moved point of the frame before.
Velocities propagate_velocities(const DynamicFrame& last, const DynamicFrame& before,
                                const Velocities& velocities);

struct VelocityInput {
  const PreparedCapture& capture;
  const std::vector<View>& views;
  const std::vector<ViewMotion>& motion;  // per view
  const std::vector<DynamicFrame>& frames;
  double reach = 0;  // upper bound, scene units per frame
  // Makes sure that `motion` has the flow of these frames, for all views.
  // Empty: velocities come from nearest neighbours.
  std::function<Status(const std::vector<int>& frames)> find_flow{};
  int interval = 1;  // of the frames with points (point_frames.h), with `find_flow` 1
  geometry::VelocityMatcher* gpu = nullptr;  // of nearest neighbours; null: on the CPU
};

struct ChosenVelocities {
  std::vector<Velocities> frames;  // one velocity per dynamic point, all known
  std::string kind = "none";       // the estimate, for logs
};

// Computes both estimates in up to three frames and chooses flow if it agrees clearly better with
// each next frame, in a stage of `work`. The last frame uses the frame before it.
Status choose_velocities(const VelocityInput& input, Work& work, ChosenVelocities* out);

}  // namespace stgs::encoder::init
