// SPDX-License-Identifier: Apache-2.0
// In the place of perceptual_network.cpp where cuDNN's headers are not there.
#include "backend/cuda/perceptual_network.h"

namespace stgs::encoder::cuda {

Status check_perceptual_network() {
  return not_built(
      "this build has no cuDNN, which the perceptual loss needs on a GPU: build again where "
      "cudnn.h is found, or leave --perceptual-weights out, or use --backend cpu");
}

Result<std::unique_ptr<PerceptualNetwork>> make_perceptual_network(std::shared_ptr<const Vgg16>,
                                                                   VggPrecision) {
  return check_perceptual_network();
}

}  // namespace stgs::encoder::cuda
