// SPDX-License-Identifier: Apache-2.0
// The kernels of blend_backward: gradients of one tile's splats, back to front.
#pragma once

#include "backend/cpu/blend_backward.h"

namespace stgs::encoder::cpu {

struct TileBackward {
  const SplatFrame& frame;
  const RasterSettings& settings;
  const RasterOutput& forward;
  const Image& d_colour;
  const Image* error;  // may be null
  int tile;
  SplatGradients* out;           // one per entry of the tile's list; all are written
  const PlanesBackward* planes;  // may be null
  math::Plane* plane_out;        // like `out`, if planes is set
};

void blend_backward_tile_scalar(const TileBackward& t);
void blend_backward_tile_vector(const TileBackward& t);

}  // namespace stgs::encoder::cpu
