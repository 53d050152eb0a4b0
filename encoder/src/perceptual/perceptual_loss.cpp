// SPDX-License-Identifier: Apache-2.0
#include "perceptual/perceptual_loss.h"

#include <cmath>
#include <utility>

#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

template <typename Visit>
void for_rows(int rows, Visit visit) {
  parallel_for(0, rows, [&visit](int y) { visit(y); });
}

// Loads the patch as network input; colour(x, y, c) returns a value of the image, [0,1].
template <typename Colour>
void load(const Patch& patch, const Colour& colour, FeatureMap& input) {
  input.reshape(patch.width, patch.height, 3);
  for_rows(patch.height, [&](int y) {
    for (int x = 0; x < patch.width; ++x) {
      float* to = input.pixel(x, y);
      for (int c = 0; c < 3; ++c)
        to[c] = (colour(patch.x + x, patch.y + y, c) - kVggMean[c]) / kVggDeviation[c];
    }
  });
}

constexpr Window kPooling = {.size = 2, .stride = 2, .padding = 0};

// Backward pass of pooling: the gradient goes to the first maximum of a window, in row order.
void pool_backward(const FeatureMap& in, const FeatureMap& d_out, FeatureMap& d_in) {
  d_in.reshape(in.width, in.height, in.channels);
  const int n = in.channels;
  for_rows(in.height, [&](int y) {
    std::fill_n(d_in.pixel(0, y), static_cast<std::size_t>(in.width) * n, 0.0f);
  });
  for_rows(d_out.height, [&](int y) {
    for (int x = 0; x < d_out.width; ++x) {
      const float* from[4] = {in.pixel(2 * x, 2 * y), in.pixel(2 * x + 1, 2 * y),
                              in.pixel(2 * x, 2 * y + 1), in.pixel(2 * x + 1, 2 * y + 1)};
      float* to[4] = {d_in.pixel(2 * x, 2 * y), d_in.pixel(2 * x + 1, 2 * y),
                      d_in.pixel(2 * x, 2 * y + 1), d_in.pixel(2 * x + 1, 2 * y + 1)};
      const float* d = d_out.pixel(x, y);
      for (int c = 0; c < n; ++c) {
        int max_index = 0;
        for (int k = 1; k < 4; ++k) max_index = from[k][c] > from[max_index][c] ? k : max_index;
        to[max_index][c] = d[c];
      }
    }
  });
}

}  // namespace

PerceptualLoss::PerceptualLoss(const Vgg16& network) : channel_weights_(network.channel_weights) {
  for (std::size_t i = 0; i < kLayers; ++i) {
    const VggLayer& layer = kVggLayers[i];
    const VggConvolution& convolution = network.convolutions[i];
    forward_[i] = {convolution.weight, convolution.bias, layer.in, layer.out};
    backward_[i] = Convolution::backward(convolution.weight, layer.in, layer.out);
  }
}

double PerceptualLoss::evaluate(const Image& image, const Image8& ground_truth, const Patch& patch,
                                float weight, Image& d_image) {
  load(
      patch,
      [&ground_truth](int x, int y, int c) {
        const std::size_t pixel = std::size_t{1} * y * ground_truth.width + x;
        return static_cast<float>(ground_truth.data[3 * pixel + c]) * (1.0f / 255.0f);
      },
      input_);
  forward();
  for (std::size_t i = 0; i < kLayers; ++i) {
    if (const int tap = kVggLayers[i].tap; tap >= 0) std::swap(features_[i], target_features_[tap]);
  }
  load(
      patch,
      [&image](int x, int y, int c) {
        return image.plane(c)[std::size_t{1} * y * image.width + x];
      },
      input_);
  forward();

  double loss = 0;
  for (std::size_t i = kLayers; i-- > 0;) {
    loss += tap_backward(i, weight);
    backward_[i].apply(gradient_, false, next_gradient_);
    if (!kVggLayers[i].pool_before) {
      std::swap(gradient_, next_gradient_);
    } else {
      pool_backward(features_[i - 1], next_gradient_, gradient_);
    }
  }
  add_gradient(patch, d_image);
  return loss;
}

void PerceptualLoss::forward() {
  const FeatureMap* in = &input_;
  for (std::size_t i = 0; i < kLayers; ++i) {
    if (kVggLayers[i].pool_before) {
      max_pool(*in, kPooling, pooled_[i]);
      in = &pooled_[i];
    }
    forward_[i].apply(*in, true, features_[i]);
    in = &features_[i];
  }
}

// Converts gradient_ to the gradient of the layer's output before ReLU: adds that of its tap, if
// any, and applies the ReLU's mask. Returns the tap's contribution to the loss.
double PerceptualLoss::tap_backward(std::size_t layer, float weight) {
  const FeatureMap& features = features_[layer];
  const int n = features.channels, tap = kVggLayers[layer].tap;
  if (layer + 1 == kLayers) {
    gradient_.reshape(features.width, features.height, n);
    for_rows(features.height, [&](int y) {
      std::fill_n(gradient_.pixel(0, y), static_cast<std::size_t>(features.width) * n, 0.0f);
    });
  }
  const auto pixels = static_cast<float>(features.width) * static_cast<float>(features.height);
  row_sums_.assign(static_cast<std::size_t>(features.height), 0.0);
  for_rows(features.height, [&](int y) {
    for (int x = 0; x < features.width; ++x) {
      const float* f = features.pixel(x, y);
      float* gradient = gradient_.pixel(x, y);
      if (tap >= 0) {
        const float* g = target_features_[tap].pixel(x, y);
        const float* w = channel_weights_[tap].data();
        float square_f = kVggEpsilon, square_g = kVggEpsilon;
        for (int c = 0; c < n; ++c) {
          square_f += f[c] * f[c];
          square_g += g[c] * g[c];
        }
        const float scale_f = 1.0f / std::sqrt(square_f), scale_g = 1.0f / std::sqrt(square_g);
        // a = f scale_f, so da_k/df_c = (delta_kc - a_k a_c) scale_f.
        float sum = 0.0f, along = 0.0f;
        for (int c = 0; c < n; ++c) {
          const float a = f[c] * scale_f, difference = a - g[c] * scale_g;
          sum += w[c] * difference * difference;
          along += w[c] * difference * a;
        }
        row_sums_[static_cast<std::size_t>(y)] += sum;
        const float scale = 2.0f * weight / pixels * scale_f;
        for (int c = 0; c < n; ++c) {
          const float a = f[c] * scale_f, difference = a - g[c] * scale_g;
          gradient[c] += scale * (w[c] * difference - along * a);
        }
      }
      for (int c = 0; c < n; ++c) gradient[c] = f[c] > 0.0f ? gradient[c] : 0.0f;
    }
  });
  double loss = 0;
  for (const double sum : row_sums_) loss += sum;
  return loss / pixels;
}

void PerceptualLoss::add_gradient(const Patch& patch, Image& d_image) {
  for_rows(patch.height, [&](int y) {
    for (int x = 0; x < patch.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(patch.y + y) * d_image.width +
                             static_cast<std::size_t>(patch.x + x);
      for (int c = 0; c < 3; ++c)
        d_image.plane(c)[at] += gradient_.pixel(x, y)[c] / kVggDeviation[c];
    }
  });
}

}  // namespace stgs::encoder
