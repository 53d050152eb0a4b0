// SPDX-License-Identifier: Apache-2.0
// The same Gaussian under other names of its axes (spec 8.5).
#pragma once

#include <array>
#include <cstddef>

#include "stgs/format/gaussian4d.h"

namespace stgs {

// Each Gaussian with the names of its axes and their signs changed so that its rotation is the
// least.
void least_rotations(Gaussians4D& set);

// What turns one Gaussian into another that may name its axes otherwise.
struct ShapeDifference {
  double angle = 0;      // radians, of the least turn between them
  double log_scale = 0;  // greatest, of axes that lie on each other after it
};
ShapeDifference shape_difference(const Gaussians4D& a, std::size_t i, const Gaussians4D& b,
                                 std::size_t j);

}  // namespace stgs
