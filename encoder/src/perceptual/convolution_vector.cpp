// SPDX-License-Identifier: Apache-2.0
#include "perceptual/convolution.h"

#include <algorithm>
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
  const float* input;    // upper left neighbour of the first pixel
  std::size_t row;       // floats per row of pixels
  std::size_t channels;  // of the input
  const float* panel;    // 9 x channels x kPanel
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
  for (std::size_t tap = 0; tap < 9; ++tap) {
    const float* HWY_RESTRICT input =
        run.input + tap / 3 * run.row + (tap % 3 + static_cast<std::size_t>(first)) * run.channels;
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

std::size_t panel_floats(int in) {
  return std::size_t{9} * static_cast<std::size_t>(in) * kPanel;
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

Convolution3x3::Convolution3x3(const std::vector<float>& weight, const std::vector<float>& bias,
                               int in, int out)
    : in_(in), bias_(bias) {
  const int panels = (out + kPanel - 1) / kPanel;
  bias_.resize(static_cast<std::size_t>(panels) * kPanel, 0.0f);
  panels_.assign(panels * panel_floats(in), 0.0f);
  for (int o = 0; o < out; ++o) {
    float* panel = panels_.data() + o / kPanel * panel_floats(in) + o % kPanel;
    for (int c = 0; c < in; ++c) {
      for (int tap = 0; tap < 9; ++tap)
        panel[(tap * in + c) * kPanel] = weight[(std::size_t{1} * o * in + c) * 9 + tap];
    }
  }
}

Convolution3x3 Convolution3x3::backward(const std::vector<float>& weight, int in, int out) {
  std::vector<float> flipped(weight.size());
  for (int o = 0; o < out; ++o) {
    for (int c = 0; c < in; ++c) {
      const std::size_t from = (std::size_t{1} * o * in + c) * 9;
      const std::size_t to = (std::size_t{1} * c * out + o) * 9;
      for (std::size_t tap = 0; tap < 9; ++tap) flipped[to + tap] = weight[from + 8 - tap];
    }
  }
  return {flipped, std::vector<float>(static_cast<std::size_t>(in), 0.0f), out, in};
}

void Convolution3x3::apply(const FeatureMap& input, bool relu, FeatureMap& output) const {
  const int channels = output_channels();
  output.reshape(input.width, input.height, channels);
  const int stride = static_cast<int>(input.stride());
  const std::size_t row = input.stride() * static_cast<std::size_t>(in_);
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
      ({input.data.data() + static_cast<std::size_t>(first) * static_cast<std::size_t>(in_), row,
        static_cast<std::size_t>(in_), panels_.data() + p * panel_floats(in_), sums, padded});
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

}  // namespace stgs::encoder
#endif
