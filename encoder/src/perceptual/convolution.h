// SPDX-License-Identifier: Apache-2.0
// 3x3 convolutions on the CPU's vector unit, channels last. Every output is one sum in a fixed
// order, so that results do not depend on the number of threads.
#pragma once

#include <cstddef>
#include <vector>

namespace stgs::encoder {

// A picture of `channels` numbers a pixel, with a border of one pixel of zeros around it.
struct FeatureMap {
  int width = 0, height = 0, channels = 0;
  std::vector<float> data;

  // Keeps the border zero; what is inside is to be written.
  void reshape(int w, int h, int c);
  std::size_t stride() const { return static_cast<std::size_t>(width) + 2; }  // pixels a row
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
  // From dL/doutput to dL/dinput of that convolution: itself a convolution, with the weights turned
  // round and their channels exchanged.
  static Convolution3x3 backward(const std::vector<float>& weight, int in, int out);

  // `output` gets output_channels() channels. In parallel over blocks of it.
  void apply(const FeatureMap& input, bool relu, FeatureMap& output) const;
  // Those asked for, and zeros up to a multiple of 16.
  int output_channels() const { return static_cast<int>(bias_.size()); }

 private:
  int in_ = 0;
  std::vector<float> panels_;  // for 16 outputs each: tap by tap, input by input, 16 weights
  std::vector<float> bias_;
};

}  // namespace stgs::encoder
