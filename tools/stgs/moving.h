// SPDX-License-Identifier: Apache-2.0
// Moving pixels of a camera: those that differ from the median background of its frames.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// A pixel is moving if a channel differs from the background by more than this, of 255.
inline constexpr int kMovingThreshold = 20;
// The background is the median of an odd number of frames, spread evenly. Fewer than the minimum
// would leave moving content in it.
inline constexpr std::size_t kMinMedianFrames = 5, kMaxMedianFrames = 15;

// Returns the indices, of `count` frames, that the median uses; empty if there are too few frames.
std::vector<std::size_t> median_frames(std::size_t count);

// Returns the median per channel of an odd number of images of the same size.
encoder::Image8 median_of(const std::vector<encoder::Image8>& images);

// Returns the median background of a camera over these frames of a capture, or an empty image if
// there are too few. Holds up to kMaxMedianFrames decoded images meanwhile.
Result<encoder::Image8> median_background(const encoder::PreparedCapture& capture,
                                          const encoder::Camera& camera,
                                          const std::vector<int>& frames);

// Sum of squared errors over pixels and channels.
struct ErrorSum {
  double squares = 0;
  std::uint64_t pixels = 0;

  ErrorSum& operator+=(const ErrorSum& other);
  // Adds pixel i, counted row by row.
  void add(const Image& image, const encoder::Image8& ground_truth, std::size_t i);
  // Returns the mean squared error. Requires pixels > 0.
  double mean() const { return squares / (3.0 * static_cast<double>(pixels)); }
};

// Returns whether a pixel moves, from its RGB values and those of the background.
bool is_moving(const std::uint8_t* pixel, const std::uint8_t* background);

// Returns the error of an image over the moving pixels of the ground truth. All three have the same
// size.
ErrorSum moving_error(const Image& image, const encoder::Image8& ground_truth,
                      const encoder::Image8& background);

}  // namespace stgs::tools
