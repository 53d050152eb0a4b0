// SPDX-License-Identifier: Apache-2.0
// Which pixels a tile has and a splat may touch: what the rasteriser's stages and the encoder's
// backward pass share.
#pragma once

#include <algorithm>

#include "stgs/format/raster.h"

namespace stgs::raster {

// Pixels [x0,x1) x [y0,y1).
struct PixelBox {
  int x0, y0, x1, y1;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
};

// First pixel whose centre is at or after `edge`, kept in [low, high]; low >= 0.
inline int first_pixel(float edge, int low, int high) {
  const float x = std::clamp(edge - 0.5f, static_cast<float>(low), static_cast<float>(high));
  const int i = static_cast<int>(x);
  return static_cast<float>(i) < x ? i + 1 : i;
}

// One past the last pixel whose centre is not after `edge`, kept in [low, high]; low >= 0.
inline int end_pixel(float edge, int low, int high) {
  return static_cast<int>(
      std::clamp(edge + 0.5f, static_cast<float>(low), static_cast<float>(high)));
}

// Pixels of `within` whose centres lie in the splat's box.
inline PixelBox covered_pixels(const Splat& s, PixelBox within) {
  return {first_pixel(s.mean.x - s.extent.x, within.x0, within.x1),
          first_pixel(s.mean.y - s.extent.y, within.y0, within.y1),
          end_pixel(s.mean.x + s.extent.x, within.x0, within.x1),
          end_pixel(s.mean.y + s.extent.y, within.y0, within.y1)};
}

// Pixels of a tile, cut at the image's edge.
inline PixelBox tile_pixels(const SplatFrame& frame, int tile) {
  const int tx = tile % frame.tiles_x, ty = tile / frame.tiles_x;
  return {tx * kTileSize, ty * kTileSize, std::min((tx + 1) * kTileSize, frame.width),
          std::min((ty + 1) * kTileSize, frame.height)};
}

}  // namespace stgs::raster
