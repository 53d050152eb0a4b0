// SPDX-License-Identifier: Apache-2.0
// Applies Adam to all learnt parameters of one primitive.
#pragma once

#include <array>

#include "backend/backend.h"
#include "train/train_state.h"

namespace stgs::encoder::cpu {

// Gradients of one primitive with respect to TrainState::values; kSh: of its first `coefficients`
// SH coefficients, coefficient then channel.
struct LearntGradients {
  std::array<const float*, kAttributes> by{};
  int coefficients = 1;
};

// Applies one step with the input's rates, then damping and the derived values. Increments the
// primitive's update count.
void adam_primitive(TrainState& state, std::size_t i, const LearntGradients& gradients,
                    const StepInput& input);

// Densification statistics of a primitive in one view.
struct ViewStatistics {
  float gradient = 0, abs_gradient = 0;  // of the loss w.r.t. image position, half image widths
  float error = 0;                       // its contribution to the error
};
// Adds a view to the statistics of primitive i.
void gather_statistics(TrainState& state, std::size_t i, const ViewStatistics& view);

}  // namespace stgs::encoder::cpu
