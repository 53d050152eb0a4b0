// SPDX-License-Identifier: Apache-2.0
#include "perceptual/convolution.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "stgs/format/parallel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "perceptual/convolution_vector.cpp"
#include <hwy/foreach_target.h>
// Must follow foreach_target.h, which includes this file once per target.
#include <hwy/highway.h>

#ifndef STGS_PERCEPTUAL_CONVOLUTION_SHAPE  // once for all targets
#define STGS_PERCEPTUAL_CONVOLUTION_SHAPE
namespace stgs::encoder::convolution {

constexpr int kPanel = 16;    // output channels computed together
constexpr int kMaxRows = 12;  // maximum number of pixels computed together

// Pixels contiguous in memory, possibly across the ends of rows.
struct PixelRun {
  const float* input;    // upper left pixel of the window of the first one
  std::size_t row;       // floats per row of pixels
  std::size_t channels;  // of the input
  int taps;              // of a window, in each direction
  const float* panel;    // taps^2 x channels x kPanel
  float* sums;           // pixels x kPanel, the result
  int pixels;            // a multiple of kMaxRows
};

}  // namespace stgs::encoder::convolution
#endif

HWY_BEFORE_NAMESPACE();
namespace stgs::encoder::convolution::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::CappedTag<float, kPanel>;
using V = hn::Vec<Tag>;

constexpr int kLanes = static_cast<int>(hn::MaxLanes(Tag()));
constexpr int kVectors = kPanel / kLanes;
// Pixels per iteration, so that the sums and the weights fit in registers.
constexpr int kRows = kVectors >= kMaxRows ? 1 : kMaxRows / kVectors;
static_assert(kMaxRows % kRows == 0);

void sum_rows(const PixelRun& run, int first) {
  const Tag d;
  V sums[kRows][kVectors];
  for (int m = 0; m < kRows; ++m) {
    for (int v = 0; v < kVectors; ++v) sums[m][v] = hn::Zero(d);
  }
  const float* HWY_RESTRICT weights = run.panel;
  const auto taps = static_cast<std::size_t>(run.taps);
  for (std::size_t tap = 0; tap < taps * taps; ++tap) {
    const float* HWY_RESTRICT input = run.input + tap / taps * run.row +
                                      (tap % taps + static_cast<std::size_t>(first)) * run.channels;
    for (std::size_t c = 0; c < run.channels; ++c, weights += kPanel) {
      V w[kVectors];
      for (int v = 0; v < kVectors; ++v) w[v] = hn::LoadU(d, weights + v * kLanes);
      for (int m = 0; m < kRows; ++m) {
        const V x = hn::Set(d, input[static_cast<std::size_t>(m) * run.channels + c]);
        for (int v = 0; v < kVectors; ++v) sums[m][v] = hn::MulAdd(x, w[v], sums[m][v]);
      }
    }
  }
  for (int m = 0; m < kRows; ++m) {
    for (int v = 0; v < kVectors; ++v)
      hn::StoreU(sums[m][v], d, run.sums + (first + m) * kPanel + v * kLanes);
  }
}

void sum_run(const PixelRun& run) {
  for (int first = 0; first < run.pixels; first += kRows) sum_rows(run, first);
}

}  // namespace
}  // namespace stgs::encoder::convolution::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stgs::encoder {
namespace convolution {
HWY_EXPORT(sum_run);
}

namespace {

using convolution::kMaxRows;
using convolution::kPanel;

constexpr int kBlock = 8 * kMaxRows;  // pixels per task
constexpr int kGroup = 4;             // panels per task

// Returns the floats of a panel of windows of `size`.
std::size_t panel_floats(int in, int size) {
  return static_cast<std::size_t>(size * size) * static_cast<std::size_t>(in) * kPanel;
}

// Copies the pixels of each window of `in`, one after the other, to a pixel of `out`.
void gather(const FeatureMap& in, const Window& window, FeatureMap& out) {
  const int n = in.channels;
  out.reshape(window.count(in.width), window.count(in.height), window.size * window.size * n);
  parallel_for(0, out.height, [&](int row) {
    for (int column = 0; column < out.width; ++column) {
      float* to = out.pixel(column, row);
      for (int tap = 0; tap < window.size * window.size; ++tap, to += n) {
        const int x = column * window.stride - window.padding + tap % window.size;
        const int y = row * window.stride - window.padding + tap / window.size;
        const bool inside = x >= 0 && y >= 0 && x < in.width && y < in.height;
        if (inside) std::copy_n(in.pixel(x, y), n, to);
        if (!inside) std::fill_n(to, n, 0.0f);
      }
    }
  });
}

}  // namespace

void FeatureMap::reshape(int w, int h, int c) {
  if (w == width && h == height && c == channels) return;
  width = w;
  height = h;
  channels = c;
  // A run may extend beyond the end by up to kMaxRows pixels.
  const std::size_t pixels = stride() * static_cast<std::size_t>(h + 2) + kMaxRows;
  data.assign(pixels * static_cast<std::size_t>(c), 0.0f);
}

Convolution::Convolution(const std::vector<float>& weight, const std::vector<float>& bias, int in,
                         int out, Window window)
    : in_(in), window_(window), bias_(bias) {
  const int panels = (out + kPanel - 1) / kPanel, taps = window.size * window.size;
  bias_.resize(static_cast<std::size_t>(panels) * kPanel, 0.0f);
  panels_.assign(panels * panel_floats(in, window.size), 0.0f);
  for (int o = 0; o < out; ++o) {
    float* panel = panels_.data() + o / kPanel * panel_floats(in, window.size) + o % kPanel;
    for (int c = 0; c < in; ++c) {
      for (int tap = 0; tap < taps; ++tap)
        panel[(tap * in + c) * kPanel] = weight[(std::size_t{1} * o * in + c) * taps + tap];
    }
  }
}

bool Convolution::gathers() const {
  const bool is_same_size = window_.stride == 1 && window_.size == 2 * window_.padding + 1;
  return !is_same_size || window_.size > 3;
}

void Convolution::apply(const FeatureMap& input, bool relu, FeatureMap& output) const {
  if (!gathers()) return apply_to_pixels(input, window_.size, relu, output);
  FeatureMap windows;
  gather(input, window_, windows);
  apply_to_pixels(windows, 1, relu, output);
}

// Applies windows of `taps`, 1 or 3, around each pixel of `input`.
void Convolution::apply_to_pixels(const FeatureMap& input, int taps, bool relu,
                                  FeatureMap& output) const {
  const int channels = output_channels();
  output.reshape(input.width, input.height, channels);
  const int stride = static_cast<int>(input.stride());
  const auto in = static_cast<std::size_t>(input.channels);
  const std::size_t row = input.stride() * in;
  const float* const begin = taps == 3 ? input.data.data() : input.pixel(0, 0);
  const int pixels =
      (input.height - 1) * stride + input.width;  // first to last, including the borders between
  const int blocks = (pixels + kBlock - 1) / kBlock;
  const int panels = channels / kPanel, groups = (panels + kGroup - 1) / kGroup;
  parallel_for(0, blocks * groups, [&](int task) {
    const int first = task % blocks * kBlock, group = task / blocks * kGroup;
    const int count = std::min(kBlock, pixels - first);
    const int padded = (count + kMaxRows - 1) / kMaxRows * kMaxRows;
    float sums[kBlock * kPanel];
    for (int p = group; p < std::min(group + kGroup, panels); ++p) {
      HWY_DYNAMIC_DISPATCH(convolution::sum_run)
      ({begin + static_cast<std::size_t>(first) * in, row, in, taps,
        panels_.data() + p * panel_floats(in_, window_.size), sums, padded});
      const float* bias = bias_.data() + p * kPanel;
      for (int i = 0; i < count; ++i) {
        const int x = (first + i) % stride, y = (first + i) / stride;
        if (x >= input.width) continue;  // the border
        float* to = output.pixel(x, y) + p * kPanel;
        for (int k = 0; k < kPanel; ++k) {
          const float value = sums[i * kPanel + k] + bias[k];
          to[k] = relu ? std::max(value, 0.0f) : value;
        }
      }
    }
  });
}

void max_pool(const FeatureMap& in, const Window& window, FeatureMap& out) {
  out.reshape(window.count(in.width), window.count(in.height), in.channels);
  parallel_for(0, out.height, [&](int row) {
    for (int column = 0; column < out.width; ++column) {
      float* const to = out.pixel(column, row);
      const int x = column * window.stride, y = row * window.stride;
      std::copy_n(in.pixel(x, y), in.channels, to);
      for (int v = y; v < std::min(y + window.size, in.height); ++v) {
        for (int u = x; u < std::min(x + window.size, in.width); ++u) {
          const float* const from = in.pixel(u, v);
          for (int c = 0; c < in.channels; ++c)
            to[c] = from[c] > to[c] || std::isnan(from[c]) ? from[c] : to[c];
        }
      }
    }
  });
}

}  // namespace stgs::encoder
#endif
