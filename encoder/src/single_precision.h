// SPDX-License-Identifier: Apache-2.0
// Training and the file format compute in single precision: numbers of a capture must be valid
// there.
#pragma once

#include <cmath>

namespace stgs::encoder {

inline bool finite_in_float(double value) {
  return std::isfinite(static_cast<float>(value));
}

inline bool positive_in_float(double value) {
  return finite_in_float(value) && static_cast<float>(value) > 0;
}

}  // namespace stgs::encoder
