// SPDX-License-Identifier: Apache-2.0
// PatchMatch over the pixels of a row on the CPU, with vectors over hypotheses.
#pragma once

#include "geometry/patch_match.h"

namespace stgs::encoder::geometry {

// start_pixel() for the pixels of row y.
void start_row(const StereoProblem& problem, const PlaneMap& map, int y, std::uint64_t seed);

// update_pixel() for the pixels of row y of one colour: those where x + y + colour is even.
void update_row(const StereoProblem& problem, const PlaneMap& map, int y, int colour, int iteration,
                std::uint64_t seed);

}  // namespace stgs::encoder::geometry
