// SPDX-License-Identifier: Apache-2.0
#include "quantise/extents.h"

#include <algorithm>
#include <cmath>

#include "codec/stream.h"

namespace stgs {

float percentile(std::vector<float> values, std::size_t hundredths) {
  if (values.empty()) return 0.0f;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * hundredths / 100);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double distance_from(const std::array<float, 3>& point, const Gaussians4D& set, std::size_t i) {
  double out = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out = std::max(out, std::abs(double{set.position[3 * i + axis]} - point[axis]));
  }
  return out;
}

double displacement_of(const Gaussians4D& set, std::size_t i, int part_exponent) {
  double out = 0.0;
  const int life = lifespan_exponent_of(set.sigma[i], set.radius[i], part_exponent);
  for (std::size_t c = 0; c < 3; ++c) {
    out = std::max(out, std::ldexp(std::abs(double{set.velocity[3 * i + c]}), life));
  }
  return out;
}

Step bounded(double octaves, double bound, double share, int in_octave) {
  const Step step = step_near(octaves, in_octave);
  if (bound == 0.0) return step;
  const Step largest = step_below(std::log2(bound * share), in_octave);
  return size_of(largest) < size_of(step) ? largest : step;
}

}  // namespace stgs
