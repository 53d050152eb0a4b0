// SPDX-License-Identifier: Apache-2.0
// VGG16's convolutions (Simonyan and Zisserman, ICLR 2015) as the perceptual loss uses them.
#pragma once

#include <array>

namespace stgs::encoder {

// A 3x3 convolution, stride 1, with zeros beyond the border; then ReLU.
struct VggLayer {
  int in, out;       // channels
  int feature;       // its number in torchvision's `features`
  bool pool_before;  // 2x2 maxima of what comes in; an odd last row or column is dropped
  int tap;           // which of the loss's features it gives, or -1
};

inline constexpr int kVggTaps = 5;  // relu1_2, relu2_2, relu3_3, relu4_3, relu5_3
inline constexpr std::array<VggLayer, 13> kVggLayers = {{
    {3, 64, 0, false, -1},
    {64, 64, 2, false, 0},
    {64, 128, 5, true, -1},
    {128, 128, 7, false, 1},
    {128, 256, 10, true, -1},
    {256, 256, 12, false, -1},
    {256, 256, 14, false, 2},
    {256, 512, 17, true, -1},
    {512, 512, 19, false, -1},
    {512, 512, 21, false, 3},
    {512, 512, 24, true, -1},
    {512, 512, 26, false, -1},
    {512, 512, 28, false, 4},
}};
inline constexpr int kVggMinSize = 16;  // pixels a side: what four poolings leave is not empty

// Colours in [0,1] go in as (colour - mean) / deviation. LPIPS's scaling layer, which takes
// [-1,1], comes to the same.
inline constexpr std::array<float, 3> kVggMean = {0.485f, 0.456f, 0.406f};
inline constexpr std::array<float, 3> kVggDeviation = {0.229f, 0.224f, 0.225f};

// Added to a pixel's squared length of features before its root is taken.
inline constexpr float kVggEpsilon = 1e-10f;

}  // namespace stgs::encoder
