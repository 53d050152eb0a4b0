// SPDX-License-Identifier: Apache-2.0
// VGG16's convolutions (Simonyan and Zisserman, ICLR 2015) as the perceptual loss uses them.
#pragma once

#include <array>

namespace stgs::encoder {

// A 3x3 convolution with stride 1 and zero padding, followed by ReLU.
struct VggLayer {
  int in, out;       // channels
  int feature;       // its index in torchvision's `features`
  bool pool_before;  // 2x2 max pooling of its input; an odd last row or column is dropped
  int tap;           // index of the tap of the loss after it, or -1
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
inline constexpr int kVggMinSize = 16;  // pixels per side, so that four poolings leave at least one

// Input normalisation: (colour - mean) / deviation, for colours in [0,1]. Equivalent to LPIPS's
// scaling layer, which takes [-1,1].
inline constexpr std::array<float, 3> kVggMean = {0.485f, 0.456f, 0.406f};
inline constexpr std::array<float, 3> kVggDeviation = {0.229f, 0.224f, 0.225f};

// Added to the squared length of a pixel's features before the square root.
inline constexpr float kVggEpsilon = 1e-10f;

}  // namespace stgs::encoder
