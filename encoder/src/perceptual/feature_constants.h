// SPDX-License-Identifier: Apache-2.0
// Constants of LPIPS, on the CPU and the GPU.
#pragma once

#include <array>

namespace stgs::encoder {

// Input normalisation: (colour - mean) / deviation, for colours in [0,1]. Equivalent to LPIPS's
// scaling layer, which takes [-1,1].
inline constexpr std::array<float, 3> kInputMean = {0.485f, 0.456f, 0.406f};
inline constexpr std::array<float, 3> kInputDeviation = {0.229f, 0.224f, 0.225f};

// The perceptual loss adds this to the squared length of a pixel's features before the square root,
// so that it has a gradient where they are zero.
inline constexpr float kSquareEpsilon = 1e-10f;

}  // namespace stgs::encoder
