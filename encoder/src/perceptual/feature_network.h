// SPDX-License-Identifier: Apache-2.0
// A network of LPIPS with its weights, supplied by the user: a chain of convolutions and poolings.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "perceptual/convolution.h"
#include "perceptual/feature_constants.h"
#include "stgs/format/byte_source.h"
#include "stgs/format/status.h"

namespace stgs::encoder {

// A convolution followed by ReLU, or a max pooling.
struct FeatureStage {
  Window window;
  int in = 0, out = 0;                 // channels
  std::vector<float> weight;           // out x in x size x size; empty: a pooling
  std::vector<float> bias;             // out
  std::vector<float> channel_weights;  // >= 0, of the features after it; empty: no tap

  bool is_pooling() const { return weight.empty(); }
  bool is_tap() const { return !channel_weights.empty(); }
};

// Every pooling follows a tap; the last stage is a tap; only the first may be a convolution with a
// stride.
struct FeatureNetwork {
  std::string name;  // "squeeze", "vgg" or "alex"
  std::vector<FeatureStage> stages;
  bool linear = false;     // channel_weights are LPIPS's; otherwise 1 / channels
  std::uint64_t hash = 0;  // of all weights

  // Returns whether every stage has an output for images of this size.
  bool accepts(int width, int height) const;
  // Returns the smallest side of an image, pixels.
  int min_side() const;
};

enum class ChannelWeights { kRequired, kOptional };

// Reads a network from a safetensors file: SqueezeNet 1.1, VGG16 or AlexNet, by torchvision's names
// of tensors (features.N.weight, features.N.bias), with LPIPS's channel weights
// (lin0.model.1.weight and so on); without any, if they are optional, all channels of a tap have
// the same weight. A fire module of SqueezeNet becomes two stages. kInvalidFile names the file, and
// the tensor if a bias or channel weight is missing or a tensor is invalid; a file without all the
// weights of a network is invalid.
Result<std::shared_ptr<const FeatureNetwork>> read_feature_network(
    std::unique_ptr<ByteSource> source, ChannelWeights channel_weights);

}  // namespace stgs::encoder
