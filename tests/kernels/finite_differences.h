// SPDX-License-Identifier: Apache-2.0
// Compares gradients with central differences of a loss.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "catch.h"

namespace stgs::testing {

// Checks gradient[k] against the central difference of problem.loss() over values[k], which the
// loss reads. `tolerance` is relative to the larger of the value and the root mean square of the
// gradient.
template <typename Problem>
void check_gradient(Problem& problem, const char* name, std::span<float> values,
                    std::span<const float> gradient, float step, double tolerance) {
  REQUIRE(values.size() == gradient.size());
  double square = 0;
  for (float g : gradient) square += static_cast<double>(g) * g;
  const double rms = std::sqrt(square / static_cast<double>(gradient.size()));
  REQUIRE(rms > 0);
  for (std::size_t k = 0; k < values.size(); ++k) {
    const float original = values[k];
    values[k] = original + step;
    const double high = values[k], above = problem.loss();
    values[k] = original - step;
    const double low = values[k], below = problem.loss();
    values[k] = original;
    const double numeric = (above - below) / (high - low);
    INFO(name << "[" << k << "]: analytic " << gradient[k] << ", numeric " << numeric << ", rms "
              << rms);
    CHECK(std::abs(numeric - gradient[k]) <=
          tolerance *
              std::max({std::abs(numeric), std::abs(static_cast<double>(gradient[k])), rms}));
  }
}

}  // namespace stgs::testing
