// SPDX-License-Identifier: Apache-2.0
// Adam for the primitives of one view: only what was visible is touched, and each primitive counts
// its own steps, so that a new one starts with the right bias correction.
#pragma once

#include <array>
#include <cstdint>

#include "train/train_state.h"

namespace stgs::encoder {

inline constexpr float kAdamBeta1 = 0.9f;
inline constexpr float kAdamBeta2 = 0.999f;
inline constexpr float kAdamEpsilon = 1e-15f;

// How much of the running means a step keeps.
struct AdamBetas {
  float first = kAdamBeta1, second = kAdamBeta2;
};

// Steps for one primitive after its count of updates went to `updates` (>= 1).
struct AdamCorrection {
  float first, second_root;  // 1 / (1 - beta1^n), 1 / sqrt(1 - beta2^n)

  explicit AdamCorrection(std::uint32_t updates, const AdamBetas& betas = {});
};

// One step over n consecutive values.
void adam_step(float* values, float* first, float* second, const float* gradient, std::size_t n,
               float rate, const AdamCorrection& correction, const AdamBetas& betas = {});

}  // namespace stgs::encoder
