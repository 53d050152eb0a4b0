// SPDX-License-Identifier: Apache-2.0
#include "train/adam.h"

#include <cmath>

namespace stgs::encoder {

AdamCorrection::AdamCorrection(std::uint32_t updates, const AdamBetas& betas)
    : first(1.0f / (1.0f - std::pow(betas.first, static_cast<float>(updates)))),
      second_root(1.0f / std::sqrt(1.0f - std::pow(betas.second, static_cast<float>(updates)))) {}

void adam_step(float* __restrict values, float* __restrict first, float* __restrict second,
               const float* __restrict gradient, std::size_t n, float rate,
               const AdamCorrection& correction, const AdamBetas& betas) {
  const float decay_first = betas.first, decay_second = betas.second;
  for (std::size_t i = 0; i < n; ++i) {
    const float g = gradient[i];
    first[i] = decay_first * first[i] + (1.0f - decay_first) * g;
    second[i] = decay_second * second[i] + (1.0f - decay_second) * g * g;
    const float scale = std::sqrt(second[i]) * correction.second_root + kAdamEpsilon;
    values[i] -= rate * (first[i] * correction.first) / scale;
  }
}

}  // namespace stgs::encoder
