// SPDX-License-Identifier: Apache-2.0
// Velocities from nearest neighbours on a GPU, in problems of limited memory and duration
// (geometry/velocity_matcher.h).
#pragma once

#include <vector>

#include "init/velocity_match.h"

namespace stgs::encoder::init {

// Returns `gpu`, which may be null, or null if a pair of frames exceeds the limits of a problem,
// with the reason in the log: the k-d trees of the CPU have no limit.
geometry::VelocityMatcher* gpu_within_limits(geometry::VelocityMatcher* gpu,
                                             const std::vector<DynamicFrame>& frames, int interval,
                                             const Work& work);

// Sets the velocities of the frames that are matched, NaN where they are unknown. `reach`: the
// longest step, scene units. Checks `work` for cancellation before each problem.
Status match_on_gpu(const std::vector<DynamicFrame>& frames, const std::vector<FrameMatch>& matches,
                    double reach, geometry::VelocityMatcher& gpu, const Work& work,
                    std::vector<Velocities>* out);

}  // namespace stgs::encoder::init
