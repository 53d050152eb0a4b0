// SPDX-License-Identifier: Apache-2.0
// What moves in a camera's pictures: the pixels that differ from the camera's median background.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"
#include "stgs/format/status.h"

namespace stgs::tools {

// A pixel moves where a channel differs from the background by more than this, of 255.
inline constexpr int kMovingThreshold = 20;
// The background is the median of an odd number of frames, spread over those given; fewer say
// little about what stands still.
inline constexpr std::size_t kFewestMedianFrames = 5, kMostMedianFrames = 15;

// Of `count` frames, the indices that the median is taken of; empty where they are too few.
std::vector<std::size_t> median_frames(std::size_t count);

// The median, channel by channel, of an odd number of pictures of one size.
encoder::Image8 median_of(const std::vector<encoder::Image8>& pictures);

// The median background of a camera over these frames of a capture, an empty picture where they are
// too few. Holds up to kMostMedianFrames pictures meanwhile.
Result<encoder::Image8> median_background(const encoder::PreparedCapture& capture,
                                          const encoder::Camera& camera,
                                          const std::vector<int>& frames);

// Squared errors summed over pixels and channels.
struct ErrorSum {
  double squares = 0;
  std::uint64_t pixels = 0;

  ErrorSum& operator+=(const ErrorSum& other);
  // Mean squared error; there must be pixels.
  double mean() const { return squares / (3.0 * static_cast<double>(pixels)); }
};

// The error of a picture against the truth within what moves in the truth. All of one size.
ErrorSum moving_error(const Image& picture, const encoder::Image8& truth,
                      const encoder::Image8& background);

}  // namespace stgs::tools
