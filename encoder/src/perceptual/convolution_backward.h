// SPDX-License-Identifier: Apache-2.0
// Backward passes of convolutions and poolings, channels last. Results do not depend on the number
// of threads.
#pragma once

#include <vector>

#include "perceptual/convolution.h"

namespace stgs::encoder {

// Converts the weights of a convolution with stride 1, out x in x taps, to those of the convolution
// that is its backward pass: in x out x taps, flipped.
std::vector<float> flipped_weights(const std::vector<float>& weight, int in, int out, int taps);
// Returns the window of that backward pass.
Window backward_window(const Window& window);

// Converts the weights of a convolution from out x in x taps to taps x in x out.
std::vector<float> weights_by_tap(const std::vector<float>& weight, int in, int out, int taps);

// Maps dL/d(output of a convolution) to dL/d(its input).
class ConvolutionBackward {
 public:
  // The weights and window of the convolution: out x in x size x size.
  ConvolutionBackward(const std::vector<float>& weight, int in, int out, Window window);

  // Reshapes `d_input` to width x height, the size of the input. Channels may be padded with zeros
  // to a multiple of 16.
  void apply(const FeatureMap& d_output, int width, int height, FeatureMap& d_input) const;

 private:
  void apply_strided(const FeatureMap& d_output, FeatureMap& d_input) const;

  int in_, out_;
  Window window_;
  Convolution flipped_;         // with stride 1: the gradient is a convolution too
  std::vector<float> weights_;  // with a stride: weights_by_tap
};

// Reshapes `d_in` to the gradient of `in`, the input of a max pooling: that of each window goes to
// its first maximum, in row order.
void max_pool_backward(const FeatureMap& in, const Window& window, const FeatureMap& d_out,
                       FeatureMap& d_in);

}  // namespace stgs::encoder
