// SPDX-License-Identifier: Apache-2.0
// The perceptual loss (paper 3.4, L_lpips) on the CPU: LPIPS (Zhang et al., CVPR 2018) with VGG16.
//
//   L = sum over taps of the mean over pixels of sum_c w_c (a_c - b_c)^2
//
// where a and b are the tap's features of the rendered image and the ground truth, normalised per
// pixel, and w are the network's channel weights.
#pragma once

#include <array>

#include "perceptual/convolution.h"
#include "perceptual/patch.h"
#include "perceptual/vgg16.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {

// Reuses its working memory between calls. Results do not depend on the number of threads. One call
// at a time per object.
class PerceptualLoss {
 public:
  explicit PerceptualLoss(const Vgg16& network);

  // Returns L of a patch and adds weight dL/dimage to `d_image`. The patch has at least kVggMinSize
  // pixels per side and lies within both images. `image` has 3 planes, nominally in [0,1];
  // `d_image` has the same size.
  double evaluate(const Image& image, const Image8& ground_truth, const Patch& patch, float weight,
                  Image& d_image);

 private:
  static constexpr std::size_t kLayers = kVggLayers.size();

  void forward();
  double tap_backward(std::size_t layer, float weight);
  void add_gradient(const Patch& patch, Image& d_image);

  std::array<Convolution, kLayers> forward_, backward_;
  std::array<std::vector<float>, kVggTaps> channel_weights_;
  FeatureMap input_;
  std::array<FeatureMap, kLayers> features_;  // after ReLU
  std::array<FeatureMap, kLayers> pooled_;    // input of layers that follow a pooling
  std::array<FeatureMap, kVggTaps> target_features_;
  FeatureMap gradient_, next_gradient_;  // dL/d(features of a layer)
  std::vector<double> row_sums_;
};

}  // namespace stgs::encoder
