// SPDX-License-Identifier: Apache-2.0
// Learning rates and loss weights of a step as functions of the training progress.
#pragma once

#include "backend/backend.h"
#include "stgs/encoder/prepared_capture.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

// Sets the SH degree in use, the learning rates and the loss weights except those of L_n and of the
// perceptual loss. `progress`: of the run, in [0, 1]. Lengths are in units of the capture.
// `coupled`: the state has the ablated representation.
void set_schedule(const HyperParameters& p, const PreparedCapture& capture, double progress,
                  bool coupled, StepInput& input);

// Adapts the schedule to steps over `views` views: the rates increase (batch_rate), and Adam's
// means decay at the same rate per view (batch_memory). Colour corrections are unaffected, because
// they still take one step per view.
void set_batch_schedule(const HyperParameters& p, int views, StepInput& input);

}  // namespace stgs::encoder
