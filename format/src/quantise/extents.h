// SPDX-License-Identifier: Apache-2.0
// Sizes and distances of primitives, from which steps are chosen.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "quantise/steps.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// Returns a percentile; 0 if there are no values.
float percentile(std::vector<float> values, std::size_t hundredths);
// Returns the distance of a primitive from a point along the axis with the greatest one; scene
// units.
double distance_from(const std::array<float, 3>& point, const Gaussians4D& set, std::size_t i);
// Returns the greatest displacement along an axis over a lifespan, scene units (spec 8.6).
double displacement_of(const Gaussians4D& set, std::size_t i, int part_exponent);

// Steps as shares of max_error; position and displacement may each use half of it. The error of a
// position is half the diagonal of a step. So is that of a displacement, over 2^E ticks. With M <
// 2^(E+1) the greater of 2 sigma and r + 1 (spec 8.6), a primitive is visible for at most r + 2.36
// sigma < 2.18 M after T, where its opacity falls to 1/255.
inline constexpr double kPositionShare = 0.5 / 0.867;
inline constexpr double kDisplacementShare = 0.5 / (0.867 * 4.36);
// Returns a step near 2^octaves that is at most this share of a bound, if there is one.
Step bounded(double octaves, double bound, double share, int in_octave);

}  // namespace stgs
