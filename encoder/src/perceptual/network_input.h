// SPDX-License-Identifier: Apache-2.0
// The input of LPIPS's networks.
#pragma once

#include "perceptual/convolution.h"
#include "perceptual/feature_constants.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {

// Reshapes `input` to width x height and normalises the colours; colour(x, y, c) returns a value of
// the image, [0,1].
template <typename Colour>
void load_network_input(int width, int height, const Colour& colour, FeatureMap& input) {
  input.reshape(width, height, 3);
  parallel_for(0, height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      float* const to = input.pixel(x, y);
      for (int c = 0; c < 3; ++c) to[c] = (colour(x, y, c) - kInputMean[c]) / kInputDeviation[c];
    }
  });
}

}  // namespace stgs::encoder
