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
// with their measured motion; static ones alive over the whole clip. Where there are too many, a
// random choice of them: of the dynamic ones by the seed, of the static ones the same for all
// windows and seeds, or the first part of it where a window has more dynamic ones. The background
// is the capture's, whatever the window and the seed (but for rounding: the start is drawn for it).
// kUsage where the initialisation is to be ablated of a capture without dynamic points.
Result<TrainState> initial_state(const PreparedCapture& capture, const HyperParameters& parameters,
                                 const Ablation& ablation, std::uint64_t seed);

}  // namespace stgs::encoder
