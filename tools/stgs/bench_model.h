// SPDX-License-Identifier: Apache-2.0
// Synthetic dynamic scenes for renderer benchmarks, derived from a static model.
#pragma once

#include <cstdint>

#include "stgs/format/scene_file.h"

namespace stgs::tools {

// Adds the dynamics of the `_dynamic` cases of tests/bench/results.csv: 300 frames, T uniform over
// them, sigma 3 frames for 30 % of the primitives and 900 for the rest, r nearly 0, speeds up to
// 0.001 units per frame and axis.
void animate(Scene& scene, std::uint64_t seed);

// Splits each primitive into `ratio` consecutive ones over 300 frames, at random times. The number
// of active primitives stays that of the model; `ratio` times as many are stored.
void multiply_stored(Scene& scene, int ratio, std::uint64_t seed);

// Extends SH to degree 3 with random coefficients.
void extend_sh(Gaussians4D& set, std::uint64_t seed);

}  // namespace stgs::tools
