// SPDX-License-Identifier: Apache-2.0
#include "perceptual/convolution_backward.h"

#include <algorithm>
#include <cstddef>

#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

// The convolution that is the backward pass of one with stride 1: its kernels are flipped, and
// their input and output channels exchanged.
Convolution flipped(const std::vector<float>& weight, int in, int out, const Window& window) {
  const auto taps = static_cast<std::size_t>(window.size) * static_cast<std::size_t>(window.size);
  std::vector<float> exchanged(weight.size());
  for (int o = 0; o < out; ++o) {
    for (int c = 0; c < in; ++c) {
      const std::size_t from = (std::size_t{1} * o * in + c) * taps;
      const std::size_t to = (std::size_t{1} * c * out + o) * taps;
      for (std::size_t tap = 0; tap < taps; ++tap)
        exchanged[to + tap] = weight[from + taps - 1 - tap];
    }
  }
  const std::vector<float> no_bias(static_cast<std::size_t>(in), 0.0f);
  return {exchanged, no_bias, out, in, {window.size, 1, window.size - 1 - window.padding}};
}

// Calls visit(index of the window, position in it) for the windows along a side, `count` of them,
// that contain this pixel.
template <typename Visit>
void for_windows(int pixel, const Window& window, int count, const Visit& visit) {
  const int last = (pixel + window.padding) / window.stride;
  for (int index = last; index >= 0; --index) {
    const int offset = pixel + window.padding - index * window.stride;
    if (offset >= window.size) return;
    if (index < count) visit(index, offset);
  }
}

struct Maximum {
  int x, y;
};

// Returns the pixel at which channel c of a window has its first maximum.
Maximum first_maximum(const FeatureMap& in, const Window& window, int column, int row, int c) {
  const int x0 = column * window.stride, y0 = row * window.stride;
  Maximum best{x0, y0};
  float most = in.pixel(x0, y0)[c];
  for (int y = y0; y < std::min(y0 + window.size, in.height); ++y) {
    for (int x = x0; x < std::min(x0 + window.size, in.width); ++x) {
      const float value = in.pixel(x, y)[c];
      if (!(value > most)) continue;
      most = value;
      best = {x, y};
    }
  }
  return best;
}

}  // namespace

std::vector<float> weights_by_tap(const std::vector<float>& weight, int in, int out, int taps) {
  std::vector<float> result(weight.size());
  for (int o = 0; o < out; ++o) {
    for (int c = 0; c < in; ++c) {
      for (int tap = 0; tap < taps; ++tap)
        result[(std::size_t{1} * tap * in + c) * out + o] =
            weight[(std::size_t{1} * o * in + c) * taps + tap];
    }
  }
  return result;
}

ConvolutionBackward::ConvolutionBackward(const std::vector<float>& weight, int in, int out,
                                         Window window)
    : in_(in), out_(out), window_(window) {
  if (window.stride == 1) {
    flipped_ = flipped(weight, in, out, window);
  } else {
    weights_ = weights_by_tap(weight, in, out, window.size * window.size);
  }
}

void ConvolutionBackward::apply(const FeatureMap& d_output, int width, int height,
                                FeatureMap& d_input) const {
  if (window_.stride == 1) return flipped_.apply(d_output, false, d_input);
  d_input.reshape(width, height, in_);
  apply_strided(d_output, d_input);
}

void ConvolutionBackward::apply_strided(const FeatureMap& d_output, FeatureMap& d_input) const {
  parallel_for(0, d_input.height, [&](int y) {
    std::fill_n(d_input.pixel(0, y), static_cast<std::size_t>(d_input.width) * in_, 0.0f);
    for_windows(y, window_, d_output.height, [&](int row, int tap_y) {
      for (int x = 0; x < d_input.width; ++x) {
        float* const to = d_input.pixel(x, y);
        for_windows(x, window_, d_output.width, [&](int column, int tap_x) {
          const float* const d = d_output.pixel(column, row);
          const float* w =
              weights_.data() + std::size_t{1} * (tap_y * window_.size + tap_x) * in_ * out_;
          for (int c = 0; c < in_; ++c, w += out_) {
            float sum = 0.0f;
            for (int o = 0; o < out_; ++o) sum += w[o] * d[o];
            to[c] += sum;
          }
        });
      }
    });
  });
}

void max_pool_backward(const FeatureMap& in, const Window& window, const FeatureMap& d_out,
                       FeatureMap& d_in) {
  d_in.reshape(in.width, in.height, in.channels);
  parallel_for(0, in.height, [&](int y) {
    std::fill_n(d_in.pixel(0, y), static_cast<std::size_t>(in.width) * in.channels, 0.0f);
    for_windows(y, window, d_out.height, [&](int row, int) {
      for (int column = 0; column < d_out.width; ++column) {
        const float* const d = d_out.pixel(column, row);
        for (int c = 0; c < in.channels; ++c) {
          const Maximum maximum = first_maximum(in, window, column, row, c);
          if (maximum.y == y) d_in.pixel(maximum.x, y)[c] += d[c];
        }
      }
    });
  });
}

}  // namespace stgs::encoder
