// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

namespace stgs {

// Returns the angle between two rotations, radians, from quaternions of any nonzero length.
inline double rotation_angle(const float* a, const float* b) {
  double dot = 0, aa = 0, bb = 0;
  for (int c = 0; c < 4; ++c) {
    dot += double{a[c]} * b[c];
    aa += double{a[c]} * a[c];
    bb += double{b[c]} * b[c];
  }
  const double sign = dot < 0 ? -1 : 1, la = 1 / std::sqrt(aa), lb = sign / std::sqrt(bb);
  double chord = 0;  // well-conditioned for small angles, unlike the arc cosine
  for (int c = 0; c < 4; ++c) {
    const double d = a[c] * la - b[c] * lb;
    chord += d * d;
  }
  return 4 * std::asin(std::min(1.0, std::sqrt(chord) / 2));
}

}  // namespace stgs
