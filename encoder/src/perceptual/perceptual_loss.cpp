// SPDX-License-Identifier: Apache-2.0
#include "perceptual/perceptual_loss.h"

#include <cmath>
#include <utility>

#include "perceptual/network_input.h"
#include "stgs/format/parallel.h"

namespace stgs::encoder {
namespace {

template <typename Visit>
void for_rows(int rows, Visit visit) {
  parallel_for(0, rows, [&visit](int y) { visit(y); });
}

}  // namespace

PerceptualLoss::PerceptualLoss(std::shared_ptr<const FeatureNetwork> network)
    : network_(std::move(network)) {
  for (const FeatureStage& stage : network_->stages) {
    std::optional<Passes>& passes = passes_.emplace_back();
    if (stage.is_pooling()) continue;
    passes.emplace(Passes{{stage.weight, stage.bias, stage.in, stage.out, stage.window},
                          {stage.weight, stage.in, stage.out, stage.window}});
  }
  features_.resize(passes_.size());
  target_features_.resize(passes_.size());
}

double PerceptualLoss::evaluate(const Image& image, const Image8& ground_truth, const Patch& patch,
                                float weight, Image& d_image) {
  const auto expected = [&](int x, int y, int c) {
    const std::size_t pixel = std::size_t{1} * (patch.y + y) * ground_truth.width + patch.x + x;
    return static_cast<float>(ground_truth.data[3 * pixel + c]) * (1.0f / 255.0f);
  };
  load_network_input(patch.width, patch.height, expected, input_);
  forward();
  for (std::size_t i = 0; i < features_.size(); ++i) {
    if (network_->stages[i].is_tap()) std::swap(features_[i], target_features_[i]);
  }
  const auto rendered = [&](int x, int y, int c) {
    return image.plane(c)[std::size_t{1} * (patch.y + y) * image.width + patch.x + x];
  };
  load_network_input(patch.width, patch.height, rendered, input_);
  forward();
  const double loss = backward(weight);
  add_gradient(patch, d_image);
  return loss;
}

void PerceptualLoss::forward() {
  const FeatureMap* in = &input_;
  for (std::size_t i = 0; i < features_.size(); ++i) {
    if (passes_[i]) {
      passes_[i]->forward.apply(*in, true, features_[i]);
    } else {
      max_pool(*in, network_->stages[i].window, features_[i]);
    }
    in = &features_[i];
  }
}

// Computes gradient_, that of the input, from the features. Returns the loss.
double PerceptualLoss::backward(float weight) {
  double loss = 0;
  const FeatureMap& last = features_.back();
  gradient_.reshape(last.width, last.height, last.channels);
  for_rows(last.height, [&](int y) {
    std::fill_n(gradient_.pixel(0, y), static_cast<std::size_t>(last.width) * last.channels, 0.0f);
  });
  for (std::size_t i = features_.size(); i-- > 0;) {
    const FeatureMap& in = i > 0 ? features_[i - 1] : input_;
    if (passes_[i]) {
      loss += tap_backward(i, weight);
      passes_[i]->backward.apply(gradient_, in.width, in.height, next_gradient_);
    } else {
      max_pool_backward(in, network_->stages[i].window, gradient_, next_gradient_);
    }
    std::swap(gradient_, next_gradient_);
  }
  return loss;
}

// Converts gradient_ to the gradient of a convolution's output before ReLU: adds that of its tap,
// if any, and applies the ReLU's mask. Returns the tap's contribution to the loss.
double PerceptualLoss::tap_backward(std::size_t stage, float weight) {
  const FeatureMap& features = features_[stage];
  const int n = features.channels;
  const bool is_tap = network_->stages[stage].is_tap();
  const float* const w = network_->stages[stage].channel_weights.data();
  const auto pixels = static_cast<float>(features.width) * static_cast<float>(features.height);
  row_sums_.assign(static_cast<std::size_t>(features.height), 0.0);
  for_rows(features.height, [&](int y) {
    for (int x = 0; x < features.width; ++x) {
      const float* f = features.pixel(x, y);
      float* gradient = gradient_.pixel(x, y);
      if (is_tap) {
        const float* g = target_features_[stage].pixel(x, y);
        float square_f = kSquareEpsilon, square_g = kSquareEpsilon;
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
        d_image.plane(c)[at] += gradient_.pixel(x, y)[c] / kInputDeviation[c];
    }
  });
}

}  // namespace stgs::encoder
