// SPDX-License-Identifier: Apache-2.0
// The encoder's steps: multiples of powers of two, so that decoding them is exact (spec 7.5), and
// as many in an octave as let the size of a file follow its quality smoothly.
#pragma once

#include <cstdint>

#include "stgs/format/coded_segment.h"

namespace stgs {

// Steps in an octave. With 4 of them, |q| may have 21 bits.
inline constexpr int kFineSteps = 8, kCoarseSteps = 4;

double size_of(Step step);
// The step nearest to 2^octaves, the greatest not above it, and the least power of two not below.
Step step_near(double octaves, int in_octave);
Step step_below(double octaves, int in_octave);
Step power_above(double octaves);
Step coarser_of(Step a, Step b);

// x in steps; halves away from 0.
std::int64_t nearest(double x, Step step);
// The multiple of the step that is nearest to x.
float on_grid(float x, Step step);

// The floats of mapping kTruncated: steps are units in the last place, counted from 1.
std::int32_t truncated_steps(float x, Step step);  // x > 0
float from_truncated(std::int32_t steps, Step step);

}  // namespace stgs
