// SPDX-License-Identifier: Apache-2.0
// Quantisation steps of the encoder: small multiples of powers of two, so that decoding is exact
// (spec 8.5), with several steps per octave, so that file size follows quality smoothly.
#pragma once

#include <cstdint>

#include "stgs/format/coded_segment.h"

namespace stgs {

// Steps per octave. With 4 of them, |q| may have 21 bits.
inline constexpr int kFineSteps = 8, kCoarseSteps = 4;

// Returns multiplier * 2^exponent.
double size_of(Step step);
// Returns the step nearest to 2^octaves.
Step step_near(double octaves, int in_octave);
// Returns the greatest step not above 2^octaves.
Step step_below(double octaves, int in_octave);
// Returns the smallest power of two not below 2^octaves.
Step power_above(double octaves);
// Returns the larger step.
Step coarser_of(Step a, Step b);

// Returns x in steps, rounded to nearest, halves away from 0.
std::int64_t nearest(double x, Step step);
// Returns the multiple of the step nearest to x.
float on_grid(float x, Step step);

// Conversion for mapping kTruncated: steps are units in the last place, counted from 1. x > 0.
std::int32_t truncated_steps(float x, Step step);
float from_truncated(std::int32_t steps, Step step);

}  // namespace stgs
