// SPDX-License-Identifier: Apache-2.0
// What the steps of a frame take, beside what they cannot do without.
#pragma once

#include <array>
#include <vector>

#include "stgs/player/renderer.h"
#include "vulkan/frame_commands.h"

namespace stgs::player::vulkan {

using StepTimes = std::array<double, kFrameSteps>;  // milliseconds

// Of a frame that has ended: what was counted, and what its steps took.
std::vector<RenderStep> steps_of(const FrameWork& work, const Counts& counts, const StepTimes& ms);

}  // namespace stgs::player::vulkan
