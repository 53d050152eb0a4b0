// SPDX-License-Identifier: Apache-2.0
// What a step's rates and weights are at a share of the run.
#pragma once

#include "backend/backend.h"
#include "stgs/encoder/prepared_capture.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

// Sets the input's harmonics in use, learning rates and weights of the losses, but for L_n's and
// the perceptual one's, where `done` in [0, 1] of the run is over. Lengths are in units of the
// capture. `coupled`: the ablated representation is what learns.
void set_schedule(const HyperParameters& p, const PreparedCapture& capture, double done,
                  bool coupled, StepInput& input);

// For steps of `views` views: fewer, larger ones (batch_rate), and Adam's means forget as much a
// view (batch_memory). A colour map has its steps a view, as ever.
void set_batch_schedule(const HyperParameters& p, int views, StepInput& input);

}  // namespace stgs::encoder
