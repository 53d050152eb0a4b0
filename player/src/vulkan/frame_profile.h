// SPDX-License-Identifier: Apache-2.0
// The times of the steps of a frame next to their lower bounds.
#pragma once

#include <array>
#include <vector>

#include "stgs/player/renderer.h"
#include "vulkan/frame_commands.h"

namespace stgs::player::vulkan {

using StepTimes = std::array<double, kFrameSteps>;  // milliseconds

// Returns the steps of a completed frame, given its counts and times.
std::vector<RenderStep> steps_of(const FrameWork& work, const Counts& counts, const StepTimes& ms);

}  // namespace stgs::player::vulkan
