// SPDX-License-Identifier: Apache-2.0
// The difference between a frame and its reference, by the measures of spec/representation.md, 7.2.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "stgs/player/renderer.h"

namespace stgs::testing {

struct FrameDifference {
  double psnr = 0;  // dB, of the colours
  std::size_t pixels = 0;
  std::size_t far_pixels = 0;  // beyond 1/255 in a channel, in alpha or in relative depth
  double worst = 0;            // largest error of a colour channel

  // At least 60 dB, and at most one far pixel in 10,000 (one in a smaller frame).
  bool agrees() const {
    return psnr >= 60 && far_pixels <= std::max<std::size_t>(1, pixels / 10000);
  }
  std::string text() const {
    return fmt::format("{:.1f} dB, {} of {} pixels beyond 1/255, largest error {:.4f}", psnr,
                       far_pixels, pixels, worst);
  }
};

inline FrameDifference difference(const player::Frame& reference, const player::Frame& found) {
  FrameDifference d;
  d.pixels = reference.alpha.data.size();
  if (found.colour.data.size() != reference.colour.data.size() ||
      found.alpha.data.size() != d.pixels || found.depth.data.size() != d.pixels) {
    d.far_pixels = d.pixels + 1;
    return d;
  }
  double squares = 0;
  for (std::size_t i = 0; i < d.pixels; ++i) {
    double largest = 0;
    for (int c = 0; c < 3; ++c) {
      const double error = std::abs(static_cast<double>(reference.colour.plane(c)[i]) -
                                    static_cast<double>(found.colour.plane(c)[i]));
      squares += error * error;
      largest = error <= largest ? largest : error;  // propagates NaN
    }
    d.worst = std::max(d.worst, largest);
    const double alpha = std::abs(static_cast<double>(reference.alpha.data[i]) -
                                  static_cast<double>(found.alpha.data[i]));
    const double depth = std::abs(static_cast<double>(reference.depth.data[i]) -
                                  static_cast<double>(found.depth.data[i]));
    const bool near = largest <= 1.0 / 255 && alpha <= 1.0 / 255 &&
                      depth <= std::abs(static_cast<double>(reference.depth.data[i])) / 255;
    d.far_pixels += !near;
  }
  const double mean = squares / (3.0 * static_cast<double>(d.pixels));
  d.psnr = mean > 0 ? -10 * std::log10(mean) : 200;
  return d;
}

}  // namespace stgs::testing
