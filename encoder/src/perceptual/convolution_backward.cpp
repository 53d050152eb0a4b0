// SPDX-License-Identifier: Apache-2.0
#include "perceptual/convolution_backward.h"

#include <algorithm>
#include <cstddef>

#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

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

std::vector<float> flipped_weights(const std::vector<float>& weight, int in, int out, int taps) {
  std::vector<float> result(weight.size());
  for (int o = 0; o < out; ++o) {
    for (int c = 0; c < in; ++c) {
      for (int tap = 0; tap < taps; ++tap)
        result[(std::size_t{1} * c * out + o) * taps + tap] =
            weight[(std::size_t{1} * o * in + c) * taps + taps - 1 - tap];
    }
  }
  return result;
}

Window backward_window(const Window& window) {
  return {window.size, 1, window.size - 1 - window.padding};
}

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
  const int taps = window.size * window.size;
  if (window.stride == 1) {
    const std::vector<float> no_bias(static_cast<std::size_t>(in), 0.0f);
    flipped_ = {flipped_weights(weight, in, out, taps), no_bias, out, in, backward_window(window)};
  } else {
    weights_ = weights_by_tap(weight, in, out, taps);
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
