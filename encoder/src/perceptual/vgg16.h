// SPDX-License-Identifier: Apache-2.0
// The weights of the perceptual loss's network, supplied by the user.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "perceptual/vgg_layers.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

struct VggConvolution {
  std::vector<float> weight;  // out x in x 3 x 3
  std::vector<float> bias;    // out
};

struct Vgg16 {
  std::array<VggConvolution, kVggLayers.size()> convolutions;
  // Weight of each channel of a tap, >= 0: LPIPS's linear layers, or 1 / channels without them.
  std::array<std::vector<float>, kVggTaps> channel_weights;
  bool linear = false;     // channel_weights are from the file
  std::uint64_t hash = 0;  // of all of the above
};

// Reads the network from a safetensors file: `features.N.weight` and `features.N.bias`
// (torchvision's names) and, if present, `lin0.model.1.weight` to `lin4.model.1.weight` (LPIPS's).
// kInvalidFile names the file and the tensor if one is missing or invalid.
Result<std::shared_ptr<const Vgg16>> read_vgg16(std::unique_ptr<ByteSource> source);

}  // namespace stgs::encoder
