// SPDX-License-Identifier: Apache-2.0
#include "perceptual/feature_network.h"

#include <xxhash.h>

#include <algorithm>
#include <utility>

#include "perceptual/lpips_networks.h"
#include "perceptual/safetensors.h"

namespace stgs::encoder {
namespace {

using Kind = LpipsLayer::Kind;
using Values = std::vector<float>;

std::string linear_name(int tap) {
  return fmt::format("lin{}.model.1.weight", tap);
}

// Reads the convolution of this name.
Result<FeatureStage> read_convolution(const Safetensors& file, const std::string& name, int in,
                                      int out, const Window& window) {
  const auto size = static_cast<std::uint64_t>(window.size);
  const auto inputs = static_cast<std::uint64_t>(in), outputs = static_cast<std::uint64_t>(out);
  FeatureStage stage{window, in, out, {}, {}, {}};
  STGS_ASSIGN(stage.weight, file.floats(name + ".weight", std::array{outputs, inputs, size, size}));
  STGS_ASSIGN(stage.bias, file.floats(name + ".bias", std::array{outputs}));
  return stage;
}

// Returns the weights of 1x1 windows as those of 3x3 windows with the same results.
Values in_centre(const Values& weight) {
  Values out(9 * weight.size(), 0.0f);
  for (std::size_t i = 0; i < weight.size(); ++i) out[9 * i + 4] = weight[i];
  return out;
}

// Reads a fire module as two stages: the first convolution, and the other two as one.
Status read_fire(const Safetensors& file, const std::string& name, const LpipsLayer& layer,
                 std::vector<FeatureStage>& stages) {
  constexpr Window kOne{1, 1, 0}, kThree;
  const int half = layer.out / 2;
  STGS_ASSIGN(FeatureStage squeeze,
              read_convolution(file, name + ".squeeze", layer.in, layer.squeezed, kOne));
  STGS_ASSIGN(FeatureStage expand,
              read_convolution(file, name + ".expand1x1", layer.squeezed, half, kOne));
  STGS_ASSIGN(const FeatureStage three,
              read_convolution(file, name + ".expand3x3", layer.squeezed, half, kThree));
  expand.window = kThree;
  expand.out = layer.out;
  expand.weight = in_centre(expand.weight);
  expand.weight.insert(expand.weight.end(), three.weight.begin(), three.weight.end());
  expand.bias.insert(expand.bias.end(), three.bias.begin(), three.bias.end());
  stages.push_back(std::move(squeeze));
  stages.push_back(std::move(expand));
  return {};
}

Status read_layer(const Safetensors& file, const LpipsLayer& layer,
                  std::vector<FeatureStage>& stages) {
  const std::string name = fmt::format("features.{}", layer.feature);
  if (layer.kind == Kind::kFire) return read_fire(file, name, layer, stages);
  if (layer.kind == Kind::kPooling) {
    const int channels = stages.back().out;
    stages.push_back({layer.window, channels, channels, {}, {}, {}});
    return {};
  }
  STGS_ASSIGN(FeatureStage stage, read_convolution(file, name, layer.in, layer.out, layer.window));
  stages.push_back(std::move(stage));
  return {};
}

// Reads the weights of the channels of a tap.
Result<Values> read_channel_weights(const Safetensors& file, int tap, int channels) {
  const std::string name = linear_name(tap);
  constexpr std::uint64_t kOne = 1;
  const std::array shape{kOne, static_cast<std::uint64_t>(channels), kOne, kOne};
  STGS_ASSIGN(Values weights, file.floats(name, shape));
  if (*std::min_element(weights.begin(), weights.end()) < 0.0f) {
    return invalid_file("{}: tensor '{}': negative channel weight (expected >= 0)", file.name(),
                        name);
  }
  return weights;
}

Status read_stages(const Safetensors& file, const LpipsNetwork& layout, FeatureNetwork& network) {
  int tap = 0;
  for (const LpipsLayer& layer : layout.layers) {
    STGS_TRY(read_layer(file, layer, network.stages));
    if (!layer.tap) continue;
    Values& weights = network.stages.back().channel_weights;
    weights.assign(static_cast<std::size_t>(layer.out), 1.0f / static_cast<float>(layer.out));
    if (!network.linear) continue;
    STGS_ASSIGN(weights, read_channel_weights(file, tap++, layer.out));
  }
  return {};
}

// Returns the layout of the network to which the tensors of a file belong.
Result<LpipsNetwork> layout_of(const Safetensors& file) {
  for (const LpipsNetwork& network : lpips_networks()) {
    const auto has_layer = [&](const LpipsLayer& layer) {
      const char* const part = layer.kind == Kind::kFire ? ".squeeze" : "";
      return layer.kind == Kind::kPooling ||
             file.contains(fmt::format("features.{}{}.weight", layer.feature, part));
    };
    if (std::all_of(network.layers.begin(), network.layers.end(), has_layer)) return network;
  }
  return invalid_file(
      "{}: not a network of LPIPS (expected the tensors of SqueezeNet 1.1, VGG16 or AlexNet under "
      "torchvision's names, features.N.weight and so on)",
      file.name());
}

bool has_channel_weights(const Safetensors& file, const LpipsNetwork& layout) {
  int tap = 0;
  for (const LpipsLayer& layer : layout.layers)
    if (layer.tap && file.contains(linear_name(tap++))) return true;
  return false;
}

std::uint64_t hash_of(const FeatureNetwork& network) {
  XXH64_hash_t hash = XXH3_64bits(network.name.data(), network.name.size()) + network.linear;
  for (const FeatureStage& stage : network.stages) {
    for (const Values* values : {&stage.weight, &stage.bias, &stage.channel_weights})
      hash = XXH3_64bits_withSeed(values->data(), values->size() * sizeof(float), hash);
  }
  return hash;
}

}  // namespace

bool FeatureNetwork::accepts(int width, int height) const {
  for (const FeatureStage& stage : stages) {
    width = stage.window.count(width);
    height = stage.window.count(height);
  }
  return width > 0 && height > 0;
}

int FeatureNetwork::min_side() const {
  int side = 1;
  while (!accepts(side, side)) ++side;
  return side;
}

Result<std::shared_ptr<const FeatureNetwork>> read_feature_network(
    std::unique_ptr<ByteSource> source, ChannelWeights channel_weights) {
  STGS_ASSIGN(const Safetensors file, Safetensors::open(std::move(source)));
  STGS_ASSIGN(const LpipsNetwork layout, layout_of(file));
  auto network = std::make_shared<FeatureNetwork>();
  network->name = layout.name;
  network->linear =
      channel_weights == ChannelWeights::kRequired || has_channel_weights(file, layout);
  STGS_TRY(read_stages(file, layout, *network));
  network->hash = hash_of(*network);
  return std::shared_ptr<const FeatureNetwork>(std::move(network));
}

}  // namespace stgs::encoder
