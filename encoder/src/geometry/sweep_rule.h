// SPDX-License-Identifier: Apache-2.0
// The costs of a plane sweep and of its smoothing, for the CPU and CUDA.
#pragma once

#include <cmath>
#include <cstdint>

#include "stgs/format/math/lang.h"

namespace stgs::encoder::geometry {

inline constexpr float kSweepTextureFloor =
    6.0f;  // variance of texture too weak to correlate, levels^2
inline constexpr float kColourScale =
    48.0f;  // colour difference with the maximum cost, grey levels
inline constexpr float kColourShare = 0.35f;  // weight of the colour term in the cost
inline constexpr int kSweepWindow = 5;        // side of the correlated windows, pixels
// Of a sweep on a GPU, at most: images that a reference is swept against, and planes.
inline constexpr int kSweepSources = 3, kMaxSweepPlanes = 128;

// Costs of a plane in the cost volume, from 0 (equal) to 254.
inline constexpr std::uint8_t kImpossible = 255;
// Returns the cost of a plane against all sources, from the two smallest, in [0, 1]. Occluded views
// match worst. With three or more views the best two count, with fewer the best.
STGS_FN std::uint8_t volume_cost(float first, float second, float seen) {
  const float cost = seen > 2.5f ? 0.5f * (first + second) : first;
  return static_cast<std::uint8_t>(std::fma(254.0f, cost, 0.5f));
}

// Penalties of semi-global matching: for a step of one plane between neighbours, and for a larger
// step between pixels whose grey values differ by `edge`.
inline constexpr int kSmallStep = 10;
STGS_FN int large_step(float edge) {
  const int step = static_cast<int>(60.0f / (1.0f + 0.15f * edge));
  return step > kSmallStep + 4 ? step : kSmallStep + 4;
}

// Returns the offset in [-0.5, 0.5] of the minimum of a parabola through three costs.
STGS_FN float parabola_offset(float before, float at, float after) {
  const float curve = before - 2.0f * at + after;
  if (!(curve > 0.0f)) return 0.0f;
  const float offset = 0.5f * (before - after) / curve;
  return offset < -0.5f ? -0.5f : offset > 0.5f ? 0.5f : offset;
}

}  // namespace stgs::encoder::geometry
