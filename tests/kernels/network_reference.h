// SPDX-License-Identifier: Apache-2.0
// The layers of LPIPS's networks by their definition in double precision: planar features, each
// convolution a sum over its window.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "network_fixture.h"

namespace stgs::testing {

// Planar features.
struct Features {
  int width = 0, height = 0, channels = 0;
  std::vector<double> data;
  Features(int w, int h, int c)
      : width(w), height(h), channels(c), data(std::size_t{1} * w * h * c) {}
  double& at(int c, int y, int x) { return data[(std::size_t{1} * c * height + y) * width + x]; }
  double at(int c, int y, int x) const {
    return data[(std::size_t{1} * c * height + y) * width + x];
  }
};

inline Features convolve(const Features& in, const Tensors& tensors, const std::string& name,
                         const encoder::Window& window) {
  const std::vector<float>&weight = tensors.at(name + ".weight").second,
        &bias = tensors.at(name + ".bias").second;
  const int n = window.size;
  const auto count = [&](int pixels) {
    return (pixels + 2 * window.padding - n) / window.stride + 1;
  };
  Features out(count(in.width), count(in.height), static_cast<int>(bias.size()));
  const auto add_tap = [&](int o, int c, int k) {
    const double w = weight[(std::size_t{1} * o * in.channels + c) * n * n + k];
    const int dx = k % n - window.padding, dy = k / n - window.padding;
    for (int y = 0; y < out.height; ++y) {
      const int v = y * window.stride + dy;
      if (v < 0 || v >= in.height) continue;
      const int begin = std::max(0, (window.stride - 1 - dx) / window.stride);
      const int end = std::min(out.width, (in.width - 1 - dx) / window.stride + 1);
      double* const to = &out.at(o, y, 0);
      const double* const from = &in.data[(std::size_t{1} * c * in.height + v) * in.width];
      for (int x = begin; x < end; ++x) to[x] += w * from[x * window.stride + dx];
    }
  };
  for (int o = 0; o < out.channels; ++o) {
    for (int c = 0; c < in.channels; ++c) {
      for (int k = 0; k < n * n; ++k) add_tap(o, c, k);
    }
    double* const first = &out.at(o, 0, 0);
    std::transform(first, first + std::size_t{1} * out.width * out.height, first,
                   [&](double sum) { return std::max(0.0, sum + bias[o]); });
  }
  return out;
}

inline Features pool(const Features& in, const encoder::Window& window) {
  const auto count = [&](int pixels) {
    const double windows = static_cast<double>(pixels - window.size) / window.stride;
    return static_cast<int>(window.ceil ? std::ceil(windows) : std::floor(windows)) + 1;
  };
  Features out(count(in.width), count(in.height), in.channels);
  for (int c = 0; c < out.channels; ++c) {
    for (int y = 0; y < out.height; ++y) {
      for (int x = 0; x < out.width; ++x) {
        const int u = x * window.stride, v = y * window.stride;
        double most = in.at(c, v, u);
        for (int k = 0; k < window.size * window.size; ++k) {
          const int s = u + k % window.size, t = v + k / window.size;
          if (s < in.width && t < in.height) most = std::max(most, in.at(c, t, s));
        }
        out.at(c, y, x) = most;
      }
    }
  }
  return out;
}

inline Features apply(const Features& in, const encoder::LpipsLayer& layer,
                      const Tensors& tensors) {
  using Kind = encoder::LpipsLayer::Kind;
  const std::string name = fmt::format("features.{}", layer.feature);
  if (layer.kind == Kind::kPooling) return pool(in, layer.window);
  if (layer.kind == Kind::kConvolution) return convolve(in, tensors, name, layer.window);
  const Features squeezed = convolve(in, tensors, name + ".squeeze", {1, 1, 0});
  Features out = convolve(squeezed, tensors, name + ".expand1x1", {1, 1, 0});
  const Features more = convolve(squeezed, tensors, name + ".expand3x3", {});
  out.data.insert(out.data.end(), more.data.begin(), more.data.end());
  out.channels += more.channels;
  return out;
}

}  // namespace stgs::testing
