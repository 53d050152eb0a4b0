// SPDX-License-Identifier: Apache-2.0
// The state before the first step, from the prepared capture's points (paper 3.3).
#pragma once

#include <cstdint>
#include <string>

#include "stgs/encoder/prepared_capture.h"
#include "train/hyper_parameters.h"
#include "train/train_state.h"

namespace stgs::encoder {

// The paper's ideas that --ablate takes away, one at a time.
struct Ablation {
  bool radius = true;      // false: r stays 0, l(t) is a Gaussian
  bool modulation = true;  // false: f = 1
  bool split = true;       // false: one long-lived, motionless cloud, no dynamic points

  static Result<Ablation> from_name(const std::string& name);
};

// Reads the capture's points and makes primitives of them: dynamic ones centred on their frame,
// with their measured motion; static ones alive over the whole clip.
Result<TrainState> initial_state(const PreparedCapture& capture, const HyperParameters& parameters,
                                 const Ablation& ablation, std::uint64_t seed);

}  // namespace stgs::encoder
