// SPDX-License-Identifier: Apache-2.0
// Networks of LPIPS with random weights, and safetensors files, for the tests.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "perceptual/feature_network.h"
#include "perceptual/lpips_networks.h"

namespace stgs::testing {

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

// The tensors of a network by torchvision's names: shape and values.
using Tensors = std::map<std::string, std::pair<std::string, std::vector<float>>>;

inline encoder::LpipsNetwork network_layout(std::string_view name) {
  for (const encoder::LpipsNetwork& network : encoder::lpips_networks())
    if (name == network.name) return network;
  throw std::logic_error("no such network");
}

// Weights that preserve the magnitude of activations (He et al., ICCV 2015). `linear`: with LPIPS's
// channel weights.
inline Tensors random_tensors(const encoder::LpipsNetwork& network, unsigned seed,
                              bool linear = true) {
  using Kind = encoder::LpipsLayer::Kind;
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(-1.0f, 1.0f);
  Tensors out;
  const auto add = [&](const std::string& name, int in, int channels, int size) {
    const float scale = std::sqrt(6.0f / static_cast<float>(size * size * in));
    std::vector<float> weight(std::size_t{1} * channels * in * size * size);
    std::vector<float> bias(static_cast<std::size_t>(channels));
    for (float& w : weight) w = scale * uniform(random);
    for (float& b : bias) b = 0.05f * uniform(random);
    out[name + ".weight"] = {fmt::format("[{},{},{},{}]", channels, in, size, size), weight};
    out[name + ".bias"] = {fmt::format("[{}]", channels), bias};
  };
  int tap = 0;
  for (const encoder::LpipsLayer& layer : network.layers) {
    const std::string name = fmt::format("features.{}", layer.feature);
    if (layer.kind == Kind::kConvolution) add(name, layer.in, layer.out, layer.window.size);
    if (layer.kind == Kind::kFire) {
      add(name + ".squeeze", layer.in, layer.squeezed, 1);
      add(name + ".expand1x1", layer.squeezed, layer.out / 2, 1);
      add(name + ".expand3x3", layer.squeezed, layer.out / 2, 3);
    }
    if (!layer.tap || !linear) continue;
    std::vector<float> weights(static_cast<std::size_t>(layer.out));
    for (float& w : weights) w = std::abs(uniform(random));
    out[fmt::format("lin{}.model.1.weight", tap++)] = {fmt::format("[1,{},1,1]", layer.out),
                                                       weights};
  }
  return out;
}

inline std::vector<std::uint8_t> tensors_file(const Tensors& tensors) {
  SafetensorsWriter writer;
  for (const auto& [name, tensor] : tensors) writer.add(name, tensor.first, tensor.second);
  return writer.take();
}

inline std::shared_ptr<const encoder::FeatureNetwork> network_of(const Tensors& tensors) {
  return encoder::read_feature_network(memory_source(tensors_file(tensors), "weights"),
                                       encoder::ChannelWeights::kOptional)
      .value();
}

inline std::shared_ptr<const encoder::FeatureNetwork> random_network(std::string_view name,
                                                                     unsigned seed, bool linear) {
  return network_of(random_tensors(network_layout(name), seed, linear));
}

}  // namespace stgs::testing
