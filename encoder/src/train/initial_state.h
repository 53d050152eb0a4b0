// SPDX-License-Identifier: Apache-2.0
// The state before the first step, from the prepared capture's points (paper 3.3).
#pragma once

#include <cstdint>

#include "stgs/encoder/prepared_capture.h"
#include "train/ablation.h"
#include "train/hyper_parameters.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Reads the capture's points and makes primitives of them: dynamic ones centred on their frame,
// with their measured motion; static ones alive over the whole clip.
Result<TrainState> initial_state(const PreparedCapture& capture, const HyperParameters& parameters,
                                 const Ablation& ablation, std::uint64_t seed);

}  // namespace stgs::encoder
