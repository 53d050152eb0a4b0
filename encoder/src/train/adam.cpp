// SPDX-License-Identifier: Apache-2.0
#include "train/adam.h"

#include <cmath>

namespace stgs::encoder {

AdamCorrection::AdamCorrection(std::uint32_t updates)
    : first(1.0f / (1.0f - std::pow(kAdamBeta1, static_cast<float>(updates)))),
      second_root(1.0f / std::sqrt(1.0f - std::pow(kAdamBeta2, static_cast<float>(updates)))) {}

void adam_step(float* __restrict values, float* __restrict first, float* __restrict second,
               const float* __restrict gradient, std::size_t n, float rate,
               const AdamCorrection& correction) {
  for (std::size_t i = 0; i < n; ++i) {
    const float g = gradient[i];
    first[i] = kAdamBeta1 * first[i] + (1.0f - kAdamBeta1) * g;
    second[i] = kAdamBeta2 * second[i] + (1.0f - kAdamBeta2) * g * g;
    const float scale = std::sqrt(second[i]) * correction.second_root + kAdamEpsilon;
    values[i] -= rate * (first[i] * correction.first) / scale;
  }
}

}  // namespace stgs::encoder
