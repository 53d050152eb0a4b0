// SPDX-License-Identifier: Apache-2.0
#include "quantise/steps.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace stgs {
namespace {

constexpr std::int32_t kOneBits = std::bit_cast<std::int32_t>(1.0f);
constexpr double kSlack = 1e-9;  // rounding error of a logarithm

// Returns multiples * 2^exponent with an odd multiplier and an exponent valid in files.
Step step_of(int multiples, int exponent) {
  while (multiples % 2 == 0) {
    multiples /= 2;
    ++exponent;
  }
  return {std::clamp(exponent, kMinExponent, kMaxExponent), multiples};
}

template <typename Round>
Step rounded(double octaves, int in_octave, const Round& round) {
  const double whole = std::floor(octaves);
  const double multiples = round(std::exp2(octaves - whole) * in_octave);
  const int below = std::countr_zero(static_cast<unsigned>(in_octave));
  return step_of(static_cast<int>(multiples), static_cast<int>(whole) - below);
}

std::int32_t unit_of(Step step) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(step.multiplier) << step.exponent);
}

}  // namespace

double size_of(Step step) {
  return std::ldexp(static_cast<double>(step.multiplier), step.exponent);
}

Step step_near(double octaves, int in_octave) {
  return rounded(octaves, in_octave, [](double x) { return std::round(x); });
}

Step step_below(double octaves, int in_octave) {
  return rounded(octaves, in_octave, [](double x) { return std::floor(x * (1.0 + kSlack)); });
}

Step power_above(double octaves) {
  return step_of(1, static_cast<int>(std::ceil(octaves - kSlack)));
}

Step coarser_of(Step a, Step b) {
  return size_of(a) < size_of(b) ? b : a;
}

std::int64_t nearest(double x, Step step) {
  constexpr double kMax = 0x1p62;
  const double steps = std::clamp(x / size_of(step), -kMax, kMax);
  return static_cast<std::int64_t>(steps + std::copysign(0.5, steps));
}

float on_grid(float x, Step step) {
  return static_cast<float>(static_cast<double>(nearest(x, step)) * size_of(step));
}

std::int32_t truncated_steps(float x, Step step) {
  const std::int32_t unit = unit_of(step), bits = std::bit_cast<std::int32_t>(x) - kOneBits;
  return (bits + (bits < 0 ? -unit / 2 : unit / 2)) / unit;
}

float from_truncated(std::int32_t steps, Step step) {
  return std::bit_cast<float>(kOneBits + steps * unit_of(step));
}

}  // namespace stgs
