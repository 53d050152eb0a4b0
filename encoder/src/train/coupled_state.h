// SPDX-License-Identifier: Apache-2.0
// Between the coupled form of 4DGS, as learnt, and the set of primitives, as drawn.
#pragma once

#include <cstddef>

#include "math/coupled.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Turns a state of round primitives (equal scales, identity rotation) in the paper's representation
// into the coupled one that looks the same. `tick`: units of time a frame, > 0.
void start_coupled(TrainState& state, float tick);

// The parameters of primitive i.
math::Coupled coupled_of(const TrainState& state, std::size_t i);

// Recomputes the scales, rotation, velocities and sigmas of primitive i.
void derive_from_coupled(TrainState& state, std::size_t i);

// The gradient by primitive i's parameters from the one by what the set holds of it.
math::Coupled coupled_backward(const TrainState& state, std::size_t i,
                               const math::CoupledPrimitiveGrad& by);

}  // namespace stgs::encoder
