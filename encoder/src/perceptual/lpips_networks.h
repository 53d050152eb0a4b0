// SPDX-License-Identifier: Apache-2.0
// The networks of LPIPS, as torchvision defines them up to the last tap.
#pragma once

#include <span>

#include "perceptual/convolution.h"

namespace stgs::encoder {

// A step of a network. Convolutions are followed by ReLU.
struct LpipsLayer {
  enum class Kind { kConvolution, kPooling, kFire };
  Kind kind = Kind::kConvolution;
  Window window;
  int feature = 0;      // index in torchvision's `features`
  int in = 0, out = 0;  // channels
  int squeezed = 0;     // of kFire: channels between its first convolution and the other two
  bool tap = false;     // the features after this layer are compared
};

struct LpipsNetwork {
  const char* name;
  std::span<const LpipsLayer> layers;
};

// SqueezeNet 1.1 (Iandola et al. 2016), VGG16 (Simonyan and Zisserman, ICLR 2015), and AlexNet
// (Krizhevsky 2014).
std::span<const LpipsNetwork> lpips_networks();

}  // namespace stgs::encoder
