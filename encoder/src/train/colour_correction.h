// SPDX-License-Identifier: Apache-2.0
// Per-camera affine colour correction, so that differences in tint and exposure between cameras do
// not enter the scene.
#pragma once

#include "stgs/format/raster.h"
#include "train/train_state.h"

namespace stgs::encoder {

// Computes corrected = matrix colour + offset per pixel; planar, 3 channels.
void apply_colour(const ColourMap& map, const Image& colour, Image& corrected);

// A background that the colour map does not act on.
struct UnmappedBackground {
  const Image& transmittance;
  math::Vec3 colour;  // as it is rendered, before the map
};

// Backward of apply_colour: replaces d_corrected (dL/dcorrected) with dL/dcolour and returns
// dL/dmap.
// `unmapped`: the background, if the map does not act on it; null: it acts on all of the image.
ColourMap colour_backward(const ColourMap& map, const Image& colour, Image& d_corrected,
                          const UnmappedBackground* unmapped = nullptr);

// Applies an Adam step to camera `index`, then shifts all cameras so that their mean is the
// identity, the correction of held-out cameras.
void update_colour(TrainState& state, std::size_t index, const ColourMap& gradient, float rate);

}  // namespace stgs::encoder
