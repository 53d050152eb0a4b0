// SPDX-License-Identifier: Apache-2.0
#include "perceptual/lpips_networks.h"

#include <algorithm>
#include <array>
#include <iterator>

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

constexpr std::array kVgg = {
    convolution(0, 3, 64, {}, false),
    convolution(2, 64, 64, {}, true),
    pooling(kPooling2),
    convolution(5, 64, 128, {}, false),
    convolution(7, 128, 128, {}, true),
    pooling(kPooling2),
    convolution(10, 128, 256, {}, false),
    convolution(12, 256, 256, {}, false),
    convolution(14, 256, 256, {}, true),
    pooling(kPooling2),
    convolution(17, 256, 512, {}, false),
    convolution(19, 512, 512, {}, false),
    convolution(21, 512, 512, {}, true),
    pooling(kPooling2),
    convolution(24, 512, 512, {}, false),
    convolution(26, 512, 512, {}, false),
    convolution(28, 512, 512, {}, true),
};

// FeatureMap has a multiple of 16 channels after a convolution. The kernels of the perceptual loss
// exist for these numbers of channels of a tap, combine the backward pass of a pooling with that of
// the tap before it, and take a stride for the convolution of the colours alone.
constexpr int kTapChannels[] = {64, 128, 192, 256, 384, 512};
constexpr bool is_supported(std::span<const LpipsLayer> layers) {
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const LpipsLayer& layer = layers[i];
    if (layer.out % 16 != 0 || layer.squeezed % 16 != 0) return false;
    if (layer.kind == Kind::kPooling && (i == 0 || !layers[i - 1].tap)) return false;
    if (layer.kind == Kind::kConvolution && layer.window.stride > 1 && layer.in != 3) return false;
    if (layer.tap && std::find(std::begin(kTapChannels), std::end(kTapChannels), layer.out) ==
                         std::end(kTapChannels))
      return false;
  }
  return layers.back().tap && layers.front().in == 3;
}
static_assert(is_supported(kSqueeze) && is_supported(kAlex) && is_supported(kVgg));

constexpr LpipsNetwork kNetworks[] = {{"squeeze", kSqueeze}, {"alex", kAlex}, {"vgg", kVgg}};

}  // namespace

std::span<const LpipsNetwork> lpips_networks() {
  return kNetworks;
}

}  // namespace stgs::encoder
