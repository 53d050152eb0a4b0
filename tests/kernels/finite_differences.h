// SPDX-License-Identifier: Apache-2.0
// Gradients against central differences of a loss.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "catch.h"

namespace stgs::testing {

// Checks gradient[k] against the differences of problem.loss() by values[k], which are part of the
// problem: within `tolerance` of itself, or of the attribute's root mean square.
template <typename Problem>
void check_gradient(Problem& problem, const char* name, std::span<float> values,
                    std::span<const float> gradient, float step, double tolerance) {
  REQUIRE(values.size() == gradient.size());
  double square = 0;
  for (float g : gradient) square += static_cast<double>(g) * g;
  const double rms = std::sqrt(square / static_cast<double>(gradient.size()));
  REQUIRE(rms > 0);
  for (std::size_t k = 0; k < values.size(); ++k) {
    const float kept = values[k];
    values[k] = kept + step;
    const double high = values[k], above = problem.loss();
    values[k] = kept - step;
    const double low = values[k], below = problem.loss();
    values[k] = kept;
    const double numeric = (above - below) / (high - low);
    INFO(name << "[" << k << "]: analytic " << gradient[k] << ", numeric " << numeric << ", rms "
              << rms);
    CHECK(std::abs(numeric - gradient[k]) <=
          tolerance *
              std::max({std::abs(numeric), std::abs(static_cast<double>(gradient[k])), rms}));
  }
}

}  // namespace stgs::testing
