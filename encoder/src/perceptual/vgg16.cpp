// SPDX-License-Identifier: Apache-2.0
#include "perceptual/vgg16.h"

#include <xxhash.h>

#include <algorithm>

#include "perceptual/safetensors.h"

namespace stgs::encoder {
namespace {

std::string linear_name(int tap) {
  return fmt::format("lin{}.model.1.weight", tap);
}

Status read_convolutions(const Safetensors& file, Vgg16& network) {
  for (std::size_t i = 0; i < kVggLayers.size(); ++i) {
    const VggLayer& layer = kVggLayers[i];
    const auto in = static_cast<std::uint64_t>(layer.in),
               out = static_cast<std::uint64_t>(layer.out);
    VggConvolution& convolution = network.convolutions[i];
    STGS_ASSIGN(convolution.weight,
                file.floats(fmt::format("features.{}.weight", layer.feature),
                            std::array{out, in, std::uint64_t{3}, std::uint64_t{3}}));
    STGS_ASSIGN(convolution.bias,
                file.floats(fmt::format("features.{}.bias", layer.feature), std::array{out}));
  }
  return {};
}

Status read_channel_weights(const Safetensors& file, Vgg16& network) {
  for (int tap = 0; tap < kVggTaps; ++tap) network.linear |= file.contains(linear_name(tap));
  for (const VggLayer& layer : kVggLayers) {
    if (layer.tap < 0) continue;
    const auto channels = static_cast<std::uint64_t>(layer.out);
    std::vector<float>& weights = network.channel_weights[layer.tap];
    if (!network.linear) {
      weights.assign(channels, 1.0f / static_cast<float>(channels));
      continue;
    }
    const std::string name = linear_name(layer.tap);
    STGS_ASSIGN(weights, file.floats(name, std::array{std::uint64_t{1}, channels, std::uint64_t{1},
                                                      std::uint64_t{1}}));
    if (*std::min_element(weights.begin(), weights.end()) < 0.0f) {
      return invalid_file("{}: tensor '{}': negative channel weight (expected >= 0)", file.name(),
                          name);
    }
  }
  return {};
}

std::uint64_t hash_of(const Vgg16& network) {
  XXH64_hash_t hash = network.linear ? 1 : 0;
  const auto add = [&hash](const std::vector<float>& values) {
    hash = XXH3_64bits_withSeed(values.data(), values.size() * sizeof(float), hash);
  };
  for (const VggConvolution& convolution : network.convolutions) {
    add(convolution.weight);
    add(convolution.bias);
  }
  for (const std::vector<float>& weights : network.channel_weights) add(weights);
  return hash;
}

}  // namespace

Result<std::shared_ptr<const Vgg16>> read_vgg16(std::unique_ptr<ByteSource> source) {
  STGS_ASSIGN(const Safetensors file, Safetensors::open(std::move(source)));
  auto network = std::make_shared<Vgg16>();
  STGS_TRY(read_convolutions(file, *network));
  STGS_TRY(read_channel_weights(file, *network));
  network->hash = hash_of(*network);
  return std::shared_ptr<const Vgg16>(std::move(network));
}

}  // namespace stgs::encoder
