// SPDX-License-Identifier: Apache-2.0
// Permutations of a Gaussian's axes that leave the Gaussian unchanged (spec 8.5).
#pragma once

#include <array>
#include <cstddef>

#include "stgs/format/gaussian4d.h"

namespace stgs {

// Permutes and flips the axes of each Gaussian so that its rotation angle is smallest.
void minimise_rotations(Gaussians4D& set);

// The difference between two Gaussians, whatever the order and signs of their axes.
struct ShapeDifference {
  double angle = 0;  // radians, smallest rotation between them
  // Differences between axes that coincide after that rotation, by axis of the first Gaussian.
  std::array<double, 3> log_scales{};
  double log_scale = 0;  // the greatest of them
};
ShapeDifference shape_difference(const Gaussians4D& a, std::size_t i, const Gaussians4D& b,
                                 std::size_t j);

}  // namespace stgs
