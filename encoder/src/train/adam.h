// SPDX-License-Identifier: Apache-2.0
// Sparse Adam: a step updates only the primitives visible in its view. Each primitive counts its
// own steps, so a new one starts with the correct bias correction.
#pragma once

#include <array>
#include <cstdint>

#include "train/train_state.h"

namespace stgs::encoder {

inline constexpr float kAdamBeta1 = 0.9f;
inline constexpr float kAdamBeta2 = 0.999f;
inline constexpr float kAdamEpsilon = 1e-15f;

// Decay factors of the running means.
struct AdamBetas {
  float first = kAdamBeta1, second = kAdamBeta2;
};

// Bias correction of a primitive whose update count, including this step, is `updates` (>= 1).
struct AdamCorrection {
  float first, second_root;  // 1 / (1 - beta1^n), 1 / sqrt(1 - beta2^n)

  explicit AdamCorrection(std::uint32_t updates, const AdamBetas& betas = {});
};

// Applies one step to n consecutive values.
void adam_step(float* values, float* first, float* second, const float* gradient, std::size_t n,
               float rate, const AdamCorrection& correction, const AdamBetas& betas = {});

}  // namespace stgs::encoder
