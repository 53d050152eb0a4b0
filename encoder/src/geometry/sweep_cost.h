// SPDX-License-Identifier: Apache-2.0
// The costs of a plane sweep for one pixel, for CUDA: the operations of plane_sweep.h in the order
// of its vectors on a CPU with fused multiply-add, so that both give the same costs. Compile
// without contraction of other products and sums.
#pragma once

#include <cstdint>

#include "geometry/sweep_rule.h"

namespace stgs::encoder::geometry {

// Maps pixel indices (x, y) of a part of a reference to those of a source, through planes parallel
// to the image of the reference. Row k of the homography of a plane with an inverse depth is
// (x[k], y[k], base[k] + inverse depth * slope[k]).
struct SweepMapping {
  float x[3], y[3];
  double base[3], slope[3];
};

// Returns an entry of the last column of the homography.
STGS_FN float last_column(const SweepMapping& mapping, int row, double inverse_depth) {
  return static_cast<float>(mapping.base[row] + inverse_depth * mapping.slope[row]);
}

// A position in a source, in indices of pixels; `seen`: in front of the camera, inside the image.
struct SweepPosition {
  float x, y;
  bool seen;
};

// `last`: the last column of the homography.
STGS_FN SweepPosition sweep_position(const SweepMapping& mapping, const float* last, int width,
                                     int height, float x, float y) {
  const float* mx = mapping.x;
  const float* my = mapping.y;
  const float z = std::fma(mx[2], x, std::fma(my[2], y, last[2]));
  const float unit = 1.0f / (z > 1e-9f ? z : 1e-9f);
  SweepPosition out;
  out.x = std::fma(mx[0], x, std::fma(my[0], y, last[0])) * unit;
  out.y = std::fma(mx[1], x, std::fma(my[1], y, last[1])) * unit;
  out.seen = z > 0.0f && out.x >= -0.5f && out.y >= -0.5f &&
             out.x < static_cast<float>(width) - 0.5f && out.y < static_cast<float>(height) - 0.5f;
  return out;
}

// Returns whether the pixel of a position that is seen is usable (SweepSource::usable).
STGS_FN bool is_usable(const std::uint32_t* usable, int width, int height, SweepPosition at) {
  if (usable == nullptr) return true;
  int x = static_cast<int>(at.x + 0.5f), y = static_cast<int>(at.y + 0.5f);
  if (x > width - 1) x = width - 1;  // the sum can be rounded up
  if (y > height - 1) y = height - 1;
  return usable[y * width + x] != 0;
}

// Returns the bilinear grey value, clamped to the image. `corners`: see StereoImage.
STGS_FN float grey_between(const std::uint32_t* corners, int width, int height, SweepPosition at) {
  const float x = math::clamped(at.x, 0.0f, static_cast<float>(width - 1));
  const float y = math::clamped(at.y, 0.0f, static_cast<float>(height - 1));
  const float x0 = std::floor(x), y0 = std::floor(y);
  const float ax = x - x0, ay = y - y0;
  const std::uint32_t four = corners[static_cast<int>(y0) * width + static_cast<int>(x0)];
  const float left = static_cast<float>(four & 0xFFu),
              right = static_cast<float>(four >> 8 & 0xFFu);
  const float below_left = static_cast<float>(four >> 16 & 0xFFu);
  const float below_right = static_cast<float>(four >> 24);
  const float above = std::fma(ax, right - left, left);
  const float below = std::fma(ax, below_right - below_left, below_left);
  return std::fma(ay, below - above, above);
}

// Sums of the values of a window, of their squares, and of their products with another window.
struct WindowSums {
  float value, square, product;
};

// Returns the sums of column x of the windows at `a` and `b`, whose rows are `pitch` apart.
STGS_FN WindowSums column_sums(const float* a, const float* b, int pitch, int x) {
  WindowSums sums{0.0f, 0.0f, 0.0f};
  for (int y = 0; y < kSweepWindow; ++y) {
    const float value = a[y * pitch + x];
    sums.value += value;
    sums.square = std::fma(value, value, sums.square);
    sums.product = std::fma(value, b[y * pitch + x], sums.product);
  }
  return sums;
}

// Returns the means over the windows.
STGS_FN WindowSums window_means(const float* a, const float* b, int pitch) {
  constexpr int kMiddle = kSweepWindow / 2;
  WindowSums sums = column_sums(a, b, pitch, kMiddle);
  for (int k = 1; k <= kMiddle; ++k) {
    const WindowSums left = column_sums(a, b, pitch, kMiddle - k);
    const WindowSums right = column_sums(a, b, pitch, kMiddle + k);
    sums.value += left.value + right.value;
    sums.square += left.square + right.square;
    sums.product += left.product + right.product;
  }
  constexpr float kShare = 1.0f / static_cast<float>(kSweepWindow * kSweepWindow);
  return {sums.value * kShare, sums.square * kShare, sums.product * kShare};
}

STGS_FN float variance_of(WindowSums means) {
  const float variance = std::fma(-means.value, means.value, means.square);
  return variance > 0.0f ? variance : 0.0f;
}

// The window of a pixel of the reference.
struct ReferenceWindow {
  float grey, mean, variance;
};

// Returns the cost in [0, 1]. `grey`: of the pixel in the source; `means`: of its window.
STGS_FN float sweep_cost(ReferenceWindow a, float grey, WindowSums means) {
  const float spread =
      (a.variance + kSweepTextureFloor) * (variance_of(means) + kSweepTextureFloor);
  const float covariance = std::fma(-a.mean, means.value, means.product);
  const float correlation = covariance / std::sqrt(spread);
  const float colour =
      0.5f / kColourScale * (std::fabs(a.mean - means.value) + std::fabs(a.grey - grey));
  const float value = std::fma(1.0f - kColourShare, math::smaller(1.0f, 1.0f - correlation),
                               kColourShare * math::smaller(1.0f, colour));
  return math::clamped(value, 0.0f, 1.0f);
}

}  // namespace stgs::encoder::geometry
