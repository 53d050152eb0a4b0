// SPDX-License-Identifier: Apache-2.0
#include "perceptual/lpips_networks.h"

#include <array>

#include "perceptual/vgg_layers.h"

namespace stgs::encoder {
namespace {

using Kind = LpipsLayer::Kind;

constexpr LpipsLayer convolution(int feature, int in, int out, Window window, bool tap) {
  return {Kind::kConvolution, window, feature, in, out, 0, tap};
}
constexpr LpipsLayer pooling(Window window) {
  return {Kind::kPooling, window};
}
// A convolution to `squeezed` channels, and one of 1x1 and one of 3x3 from these to half of `out`
// each, side by side.
constexpr LpipsLayer fire(int feature, int in, int squeezed, int out, bool tap) {
  return {Kind::kFire, {}, feature, in, out, squeezed, tap};
}

constexpr Window kPooling3{3, 2, 0}, kPooling3Ceil{3, 2, 0, true}, kPooling2{2, 2, 0};

constexpr std::array kSqueeze = {
    convolution(0, 3, 64, {3, 2, 0}, true),
    pooling(kPooling3Ceil),
    fire(3, 64, 16, 128, false),
    fire(4, 128, 16, 128, true),
    pooling(kPooling3Ceil),
    fire(6, 128, 32, 256, false),
    fire(7, 256, 32, 256, true),
    pooling(kPooling3Ceil),
    fire(9, 256, 48, 384, true),
    fire(10, 384, 48, 384, true),
    fire(11, 384, 64, 512, true),
    fire(12, 512, 64, 512, true),
};

constexpr std::array kAlex = {
    convolution(0, 3, 64, {11, 4, 2}, true),  pooling(kPooling3),
    convolution(3, 64, 192, {5, 1, 2}, true), pooling(kPooling3),
    convolution(6, 192, 384, {}, true),       convolution(8, 384, 256, {}, true),
    convolution(10, 256, 256, {}, true),
};

constexpr int kVggPoolings = 4;
constexpr auto kVgg = [] {
  std::array<LpipsLayer, kVggLayers.size() + kVggPoolings> out{};
  std::size_t at = 0;
  for (const VggLayer& layer : kVggLayers) {
    if (layer.pool_before) out[at++] = pooling(kPooling2);
    out[at++] = convolution(layer.feature, layer.in, layer.out, {}, layer.tap >= 0);
  }
  return out;
}();

// FeatureMap has a multiple of 16 channels after a convolution.
constexpr bool has_whole_panels(std::span<const LpipsLayer> layers) {
  for (const LpipsLayer& layer : layers)
    if (layer.out % 16 != 0 || layer.squeezed % 16 != 0) return false;
  return true;
}
static_assert(has_whole_panels(kSqueeze) && has_whole_panels(kAlex) && has_whole_panels(kVgg));

constexpr LpipsNetwork kNetworks[] = {{"squeeze", kSqueeze}, {"alex", kAlex}, {"vgg", kVgg}};

}  // namespace

std::span<const LpipsNetwork> lpips_networks() {
  return kNetworks;
}

}  // namespace stgs::encoder
