// SPDX-License-Identifier: Apache-2.0
// SIMD convolutions and poolings, channels last. Every output is a single sum in a fixed order, so
// results do not depend on the number of threads.
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

// A square window that moves over a map.
struct Window {
  int size = 3, stride = 1;
  int padding = 1;    // pixels of zeros on each side; for a pooling 0
  bool ceil = false;  // the last window may extend beyond the map; for a pooling alone
  // Returns the number of windows along a side of this many pixels.
  int count(int pixels) const {
    const int slack = pixels + 2 * padding - size;
    return slack < 0 ? 0 : (slack + (ceil ? stride - 1 : 0)) / stride + 1;
  }
};

class Convolution {
 public:
  Convolution() = default;
  // weight: out x in x size x size; bias: out.
  Convolution(const std::vector<float>& weight, const std::vector<float>& bias, int in, int out,
              Window window = {});
  // Convolves `input`, which has at least one window, and reshapes `output` to output_channels().
  // Parallel over blocks of the output.
  void apply(const FeatureMap& input, bool relu, FeatureMap& output) const;
  // Returns the number of output channels, padded with zero channels to a multiple of 16.
  int output_channels() const { return static_cast<int>(bias_.size()); }
  const Window& window() const { return window_; }
  // Returns whether apply() gathers the pixels of each window first: size^2 maps of the output's
  // size.
  bool gathers() const;

 private:
  void apply_to_pixels(const FeatureMap& input, int taps, bool relu, FeatureMap& output) const;

  int in_ = 0;
  Window window_;
  std::vector<float> panels_;  // per 16 outputs: for each tap and input, 16 weights
  std::vector<float> bias_;
};

// Reshapes `out` to the maxima of the windows of `in`.
void max_pool(const FeatureMap& in, const Window& window, FeatureMap& out);

}  // namespace stgs::encoder
