// SPDX-License-Identifier: Apache-2.0
// Replaces perceptual_network.cpp in builds without cuDNN's headers.
#include "backend/cuda/perceptual_network.h"

namespace stgs::encoder::cuda {

Status check_perceptual_network() {
  return not_built(
      "this build has no cuDNN, which the perceptual loss on a GPU requires; rebuild with cudnn.h "
      "available, omit --perceptual-weights or use --backend cpu");
}

Result<std::unique_ptr<PerceptualNetwork>> make_perceptual_network(
    std::shared_ptr<const FeatureNetwork>, ConvolutionPrecision) {
  return check_perceptual_network();
}

}  // namespace stgs::encoder::cuda
