// SPDX-License-Identifier: Apache-2.0
// What packing costs in pictures.
#pragma once

#include <optional>

#include "stgs/format/scene_file.h"

namespace stgs::encoder {

inline constexpr int kPsnrImages = 8;

// How far the pictures of `packed` are from those of `scene`: PSNR of the mean squared error over
// kPsnrImages pictures of values in [0,1], dB, kPsnrMax at most; half of them of the start
// camera, spread over time, half of cameras that have gone around what it looks at by a few
// degrees. Nothing where there is no start camera. Larger ones are drawn with at most 1280 pixels
// a side. Uses all threads; throws std::length_error as bin() does.
std::optional<double> render_psnr(const Scene& scene, const Scene& packed);

}  // namespace stgs::encoder
