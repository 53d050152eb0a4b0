// SPDX-License-Identifier: Apache-2.0
// Per-camera affine colour: real cameras differ in tint and exposure, the scene should not.
#pragma once

#include "stgs/format/raster.h"
#include "train/train_state.h"

namespace stgs::encoder {

// shown = matrix colour + offset, pixel by pixel; planar, 3 channels.
void apply_colour(const ColourMap& map, const Image& colour, Image& shown);

// From dL/dshown: dL/dcolour (in place of d_shown) and dL/dmap.
ColourMap colour_backward(const ColourMap& map, const Image& colour, Image& d_shown);

// Adam on camera `index`, then moves the mean of all cameras back to the identity, which is what a
// held-out camera is shown with.
void update_colour(TrainState& state, std::size_t index, const ColourMap& gradient, float rate);

}  // namespace stgs::encoder
