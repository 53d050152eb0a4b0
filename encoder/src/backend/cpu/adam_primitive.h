// SPDX-License-Identifier: Apache-2.0
// Adam on all that is learnt of one primitive.
#pragma once

#include <array>

#include "backend/backend.h"
#include "train/train_state.h"

namespace stgs::encoder::cpu {

// Gradients by TrainState::values of one primitive; kSh: of its first `coefficients` harmonics,
// coefficient then channel.
struct LearntGradients {
  std::array<const float*, kAttributes> by{};
  int coefficients = 1;
};

// One step with the input's rates, then what follows from the new values. `updates` is counted on.
void adam_primitive(TrainState& state, std::size_t i, const LearntGradients& gradients,
                    const StepInput& input);

// Adds what a view has shown of primitive i to the statistics for densification.
struct ViewStatistics {
  float gradient = 0, abs_gradient = 0;  // of the loss by image position, half image widths
  float error = 0;                       // its share of the error
};
void gather_statistics(TrainState& state, std::size_t i, const ViewStatistics& seen);

}  // namespace stgs::encoder::cpu
