// SPDX-License-Identifier: Apache-2.0
// Converts between the coupled form of 4DGS, as learnt, and the set of primitives, as rendered.
#pragma once

#include <cstddef>

#include "math/coupled.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Converts a state of isotropic primitives (equal scales, identity rotation) from the paper's
// representation to the coupled one that renders the same. `tick`: units of time per frame, > 0.
void start_coupled(TrainState& state, float tick);

// Returns the coupled parameters of primitive i.
math::Coupled coupled_of(const TrainState& state, std::size_t i);

// Recomputes the scales, rotation, velocities and sigmas of primitive i.
void derive_from_coupled(TrainState& state, std::size_t i);

// Converts the gradient of primitive i in the set to that of its coupled parameters.
math::Coupled coupled_backward(const TrainState& state, std::size_t i,
                               const math::CoupledPrimitiveGrad& by);

}  // namespace stgs::encoder
