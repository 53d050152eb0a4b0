// SPDX-License-Identifier: Apache-2.0
// The perceptual loss (paper 3.4, L_lpips) on the CPU: LPIPS (Zhang et al., CVPR 2018).
//
//   L = sum over taps of the mean over pixels of sum_c w_c (a_c - b_c)^2
//
// where a and b are the tap's features of the rendered image and the ground truth, normalised per
// pixel, and w are the network's channel weights.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "perceptual/convolution.h"
#include "perceptual/convolution_backward.h"
#include "perceptual/feature_network.h"
#include "perceptual/patch.h"
#include "stgs/encoder/prepared_capture.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {

// Reuses its working memory between calls. Results do not depend on the number of threads. One call
// at a time per object.
class PerceptualLoss {
 public:
  explicit PerceptualLoss(std::shared_ptr<const FeatureNetwork> network);

  // Returns L of a patch and adds weight dL/dimage to `d_image`. The network accepts the patch,
  // which lies within both images. `image` has 3 planes, nominally in [0,1]; `d_image` has the same
  // size.
  double evaluate(const Image& image, const Image8& ground_truth, const Patch& patch, float weight,
                  Image& d_image);

 private:
  // A convolution and its backward pass; none for a pooling.
  struct Passes {
    Convolution forward;
    ConvolutionBackward backward;
  };

  void forward();
  double backward(float weight);
  double tap_backward(std::size_t stage, float weight);
  void add_gradient(const Patch& patch, Image& d_image);

  std::shared_ptr<const FeatureNetwork> network_;
  std::vector<std::optional<Passes>> passes_;  // of the stages
  FeatureMap input_;
  std::vector<FeatureMap> features_;         // outputs of the stages
  std::vector<FeatureMap> target_features_;  // of the taps among them
  FeatureMap gradient_, next_gradient_;      // dL/d(output of a stage)
  std::vector<double> row_sums_;
};

}  // namespace stgs::encoder
