// SPDX-License-Identifier: Apache-2.0
// L_t, L_opacity and L_scale over a view's visible primitives (paper 3.4): values and gradients.
#pragma once

#include "backend/backend.h"
#include "stgs/format/raster.h"
#include "train/train_state.h"

namespace stgs::encoder::cpu {

// Returns the weighted sum of the three, each a mean over the splats of a frame.
double regularisation_loss(const TrainState& state, const SplatFrame& frame,
                           const StepInput& input);

// Adds the gradients of primitive i, one of `visible` primitives. d_log_scale: 3 values.
void regularise(const TrainState& state, std::size_t visible, std::size_t i, const StepInput& input,
                float* d_log_scale, float& d_opacity_logit, float& d_sigma, float& d_radius);

}  // namespace stgs::encoder::cpu
