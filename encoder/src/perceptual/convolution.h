// SPDX-License-Identifier: Apache-2.0
// SIMD 3x3 convolutions, channels last. Every output is a single sum in a fixed order, so results
// do not depend on the number of threads.
#pragma once

#include <cstddef>
#include <vector>

namespace stgs::encoder {

// An image with `channels` values per pixel and a border of one zero pixel.
struct FeatureMap {
  int width = 0, height = 0, channels = 0;
  std::vector<float> data;

  // Resizes the map and zeroes the border. The caller must write the interior.
  void reshape(int w, int h, int c);
  // Returns the pixels per row, including the border.
  std::size_t stride() const { return static_cast<std::size_t>(width) + 2; }
  float* pixel(int x, int y) { return data.data() + index(x, y); }
  const float* pixel(int x, int y) const { return data.data() + index(x, y); }

 private:
  std::size_t index(int x, int y) const {
    return (static_cast<std::size_t>(y + 1) * stride() + static_cast<std::size_t>(x + 1)) *
           static_cast<std::size_t>(channels);
  }
};

class Convolution3x3 {
 public:
  Convolution3x3() = default;
  // weight: out x in x 3 x 3; bias: out.
  Convolution3x3(const std::vector<float>& weight, const std::vector<float>& bias, int in, int out);
  // Returns the convolution that maps dL/doutput to dL/dinput: the kernels are flipped, and their
  // input and output channels exchanged.
  static Convolution3x3 backward(const std::vector<float>& weight, int in, int out);

  // Convolves `input` and reshapes `output` to output_channels(). Parallel over blocks of the
  // output.
  void apply(const FeatureMap& input, bool relu, FeatureMap& output) const;
  // Returns the number of output channels, padded with zero channels to a multiple of 16.
  int output_channels() const { return static_cast<int>(bias_.size()); }

 private:
  int in_ = 0;
  std::vector<float> panels_;  // per 16 outputs: for each tap and input, 16 weights
  std::vector<float> bias_;
};

}  // namespace stgs::encoder
