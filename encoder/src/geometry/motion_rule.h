// SPDX-License-Identifier: Apache-2.0
// Rules of motion detection for single pixels, for CUDA, and their constants, also for the CPU.
// Their integers equal those of OpenCV in init/background.h and init/motion.h. Images are 8-bit
// RGB; rows without gaps.
#pragma once

#include <algorithm>
#include <cstdint>

#include "geometry/flow_rule.h"

namespace stgs::encoder::geometry {

// Radius by which given masks are dilated, pixels: those of other tools often exclude the blurred
// border of an object.
inline constexpr int kMaskReach = 2;

// Mirrors an index beyond an image without repeating the border.
STGS_FN int mirrored_index(int i, int n) {
  if (n == 1) return 0;
  return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}

// Returns the mean of the 3x3 pixels around (x, y), of a channel.
STGS_FN int blurred_at(const std::uint8_t* image, int channels, int width, int height, int x, int y,
                       int channel) {
  int sum = 0;
  for (int j = -1; j <= 1; ++j) {
    const int row = mirrored_index(y + j, height) * width;
    for (int i = -1; i <= 1; ++i)
      sum += image[channels * (row + mirrored_index(x + i, width)) + channel];
  }
  return (sum + 4) / 9;
}

STGS_FN int grey_level_of(const std::uint8_t* rgb) {
  return (9798 * rgb[0] + 19235 * rgb[1] + 3735 * rgb[2] + (1 << 14)) >> 15;
}

// Returns 64 times the squared slope of a grey image at (x, y), by Sobel's filter.
STGS_FN int squared_slope_at(const std::uint8_t* grey, int width, int height, int x, int y) {
  const int left = mirrored_index(x - 1, width), right = mirrored_index(x + 1, width);
  const std::uint8_t* const above = grey + mirrored_index(y - 1, height) * width;
  const std::uint8_t* const row = grey + y * width;
  const std::uint8_t* const below = grey + mirrored_index(y + 1, height) * width;
  const int dx =
      above[right] - above[left] + 2 * (row[right] - row[left]) + below[right] - below[left];
  const int dy =
      below[left] - above[left] + 2 * (below[x] - above[x]) + below[right] - above[right];
  return dx * dx + dy * dy;
}

// By which the threshold of a change grows, per grey level of slope.
inline constexpr double kSlopeShare = 0.15;
// Returns the smallest change from the background that counts, grey levels. `squared_slope`: the
// largest around the pixel; `base`: threshold_base() of the camera.
STGS_FN float change_threshold_of(int squared_slope, float base) {
  const float slope = 0.125f * std::sqrt(static_cast<float>(squared_slope));
  return static_cast<float>(kSlopeShare) * slope + base;
}
inline double threshold_base(double noise) {
  return 6.0 + 3.0 * noise;
}

// Thresholds of a change that is certain, and of one that the flow confirms, in units of that of a
// weak change.
inline constexpr float kStrongChange = 2.0f, kFlowingChange = 0.5f;
// Whether a change is seen, and whether it is certain. `is_flowing`: it moves by the flow.
STGS_FN bool is_weak_change(float change, float threshold, bool is_flowing) {
  return change > threshold || (is_flowing && change > kFlowingChange * threshold);
}
STGS_FN bool is_strong_change(float change, float threshold, bool is_flowing) {
  return change > kStrongChange * threshold || (is_flowing && change > kFlowingChange * threshold);
}

// Areas of components, pixels: those of masks that remain, and of holes that are filled.
inline int smallest_component(int pixels) {
  return std::max(8, pixels / 12000);
}
inline int largest_hole(int pixels) {
  return pixels / 120;
}

// Lengths of flow are counted in bins, whose last has all longer ones, for their median.
inline constexpr int kLengthBins = 256;
inline constexpr float kLengthBin = 0.001f;  // pixels
STGS_FN int length_bin_of(float length) {
  return static_cast<int>(math::smaller(length / kLengthBin, static_cast<float>(kLengthBins - 1)));
}
// Returns the middle of a bin, pixels.
STGS_FN float binned_length(int bin) {
  return kLengthBin * (static_cast<float>(bin) + 0.5f);
}
// Returns the length of flow beyond which a pixel moves, from the median; both in pixels.
STGS_FN float moving_length_of(float median) {
  return math::clamped(5.0f * median, 0.4f, 1.0f);
}

// Flow as whole numbers, in units of 1/32 pixel.
inline constexpr int kUnknownFlow = -32768;
inline constexpr int kFlowUnits = 32;  // per pixel
STGS_FN int packed_flow(float flow) {
  const float rounded = std::floor(std::abs(flow) * static_cast<float>(kFlowUnits) + 0.5f);
  return static_cast<int>(flow < 0.0f ? -rounded : rounded);
}
STGS_FN bool is_known_flow(Vec2 flow) {
  return std::abs(flow.x) < 1000.0f && std::abs(flow.y) < 1000.0f;
}

// Returns the standard deviation of static pixels, grey levels, from their median absolute
// deviations: `counts[d]` pixels have d, in [0, 256). 1 without any.
inline double noise_of(const std::uint32_t* counts) {
  std::uint64_t counted = 0, below = 0;
  for (int level = 0; level < 256; ++level) counted += counts[level];
  for (int level = 0; level < 256 && counted > 0; ++level) {
    if (2 * (below + counts[level]) < counted) {
      below += counts[level];
      continue;
    }
    const double inside = (0.5 * double(counted) - double(below)) / double(counts[level]);
    return std::clamp(1.4826 * (level - 0.5 + inside), 0.7, 12.0);  // interpolated in the level
  }
  return 1;
}

}  // namespace stgs::encoder::geometry
