// SPDX-License-Identifier: Apache-2.0
// Measures the loss of packing in renders.
#pragma once

#include <optional>

#include "stgs/format/scene_file.h"

namespace stgs::encoder {

inline constexpr int kPsnrImages = 8;

// Returns the PSNR of renders of `packed` against renders of `scene`, dB, at most kPsnrMax: that of
// the mean squared error over kPsnrImages images with values in [0,1]. Half of them are from the
// start camera, spread over time; half are from cameras orbited by a few degrees around the point
// at the centre of its view. Renders have at most 1280 pixels per side. Returns nullopt if there is
// no start camera. Uses all threads; throws std::length_error under the same conditions as bin().
std::optional<double> render_psnr(const Scene& scene, const Scene& packed);

}  // namespace stgs::encoder
