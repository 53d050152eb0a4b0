// SPDX-License-Identifier: Apache-2.0
// VGG16 networks with random weights, and safetensors files, for the tests of the perceptual loss.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "perceptual/vgg16.h"

namespace stgs::testing {

// Weights that preserve the magnitude of activations (He et al., ICCV 2015).
inline encoder::Vgg16 random_vgg16(unsigned seed, bool linear) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  encoder::Vgg16 network;
  network.linear = linear;
  for (std::size_t i = 0; i < encoder::kVggLayers.size(); ++i) {
    const encoder::VggLayer& layer = encoder::kVggLayers[i];
    encoder::VggConvolution& convolution = network.convolutions[i];
    const float scale = std::sqrt(6.0f / (9.0f * static_cast<float>(layer.in)));
    convolution.weight.resize(std::size_t{9} * layer.in * layer.out);
    for (float& w : convolution.weight) w = scale * uniform(random);
    convolution.bias.resize(static_cast<std::size_t>(layer.out));
    for (float& b : convolution.bias) b = 0.05f * uniform(random);
    if (layer.tap < 0) continue;
    std::vector<float>& weights = network.channel_weights[layer.tap];
    weights.assign(static_cast<std::size_t>(layer.out), 1.0f / static_cast<float>(layer.out));
    if (!linear) continue;
    for (float& w : weights) w = std::abs(uniform(random));
  }
  return network;
}

// A safetensors file: length of the header, header, data.
inline std::vector<std::uint8_t> safetensors_file(const std::string& header,
                                                  const std::vector<std::uint8_t>& data) {
  std::vector<std::uint8_t> bytes;
  for (int i = 0; i < 8; ++i)
    bytes.push_back(static_cast<std::uint8_t>(std::uint64_t{header.size()} >> (8 * i)));
  bytes.insert(bytes.end(), header.begin(), header.end());
  bytes.insert(bytes.end(), data.begin(), data.end());
  return bytes;
}

// Writes arrays of 32-bit floats as a safetensors file, in the order of add().
class SafetensorsWriter {
 public:
  void add(const std::string& name, const std::string& shape, const std::vector<float>& values) {
    header_ += fmt::format("{}\"{}\":{{\"dtype\":\"F32\",\"shape\":{},\"data_offsets\":[{},{}]}}",
                           header_.empty() ? "{" : ",", name, shape, data_.size(),
                           data_.size() + 4 * values.size());
    for (const float value : values) {
      const auto bits = std::bit_cast<std::uint32_t>(value);
      for (int k = 0; k < 4; ++k) data_.push_back(static_cast<std::uint8_t>(bits >> (8 * k)));
    }
  }
  std::vector<std::uint8_t> take() { return safetensors_file(header_ + "}", data_); }

 private:
  std::string header_;
  std::vector<std::uint8_t> data_;
};

// The network under the tensor names that read_vgg16 expects, except the tensor `left_out`.
inline std::vector<std::uint8_t> vgg16_file(const encoder::Vgg16& network,
                                            const std::string& left_out = "") {
  SafetensorsWriter writer;
  const auto add = [&](const std::string& name, const std::string& shape, const auto& values) {
    if (name != left_out) writer.add(name, shape, values);
  };
  for (std::size_t i = 0; i < encoder::kVggLayers.size(); ++i) {
    const encoder::VggLayer& layer = encoder::kVggLayers[i];
    const std::string name = fmt::format("features.{}.", layer.feature);
    add(name + "weight", fmt::format("[{},{},3,3]", layer.out, layer.in),
        network.convolutions[i].weight);
    add(name + "bias", fmt::format("[{}]", layer.out), network.convolutions[i].bias);
    if (layer.tap < 0 || !network.linear) continue;
    add(fmt::format("lin{}.model.1.weight", layer.tap), fmt::format("[1,{},1,1]", layer.out),
        network.channel_weights[layer.tap]);
  }
  return writer.take();
}

}  // namespace stgs::testing
