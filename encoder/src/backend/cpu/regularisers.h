// SPDX-License-Identifier: Apache-2.0
// L_t, L_opacity and L_scale over a view's visible primitives (paper 3.4): values and gradients.
#pragma once

#include <span>

#include "backend/backend.h"
#include "stgs/format/raster.h"

namespace stgs::encoder::cpu {

// `set`: as rendered.
// Returns the weighted sum of the three over the splats of a frame that are not fixed, divided by
// the number of all. `updates`: TrainState's.
double regularisation_loss(const Gaussians4D& set, std::span<const std::uint32_t> updates,
                           const SplatFrame& frame, const StepInput& input);

// Adds the gradients of primitive i, one of `visible` primitives. d_log_scale: 3 values.
void regularise(const Gaussians4D& set, std::size_t visible, std::size_t i, const StepInput& input,
                float* d_log_scale, float& d_opacity_logit, float& d_sigma, float& d_radius);

}  // namespace stgs::encoder::cpu
