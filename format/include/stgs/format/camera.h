// SPDX-License-Identifier: Apache-2.0
// Limits on cameras, shared by files, captures and the command line.
#pragma once

#include <cmath>

namespace stgs {

inline constexpr int kMaxImageSide = 32768;         // pixels (spec/stgs-format.md, 4.3)
inline constexpr double kRotationTolerance = 1e-3;  // largest error of R R' - 1 (spec, 4.3)

// Returns whether the row-major matrix is a rotation: orthonormal within kRotationTolerance, with a
// positive determinant.
template <typename Number>
bool is_rotation(const Number (&r)[9]) {
  for (int a = 0; a < 3; ++a) {
    for (int b = a; b < 3; ++b) {
      double dot = 0;
      for (int c = 0; c < 3; ++c) dot += static_cast<double>(r[3 * a + c]) * r[3 * b + c];
      if (!(std::abs(dot - (a == b ? 1 : 0)) <= kRotationTolerance)) return false;
    }
  }
  const double determinant = static_cast<double>(r[0]) * (r[4] * r[8] - r[5] * r[7]) -
                             r[1] * (r[3] * r[8] - r[5] * r[6]) +
                             r[2] * (r[3] * r[7] - r[4] * r[6]);
  return determinant > 0;
}

}  // namespace stgs
