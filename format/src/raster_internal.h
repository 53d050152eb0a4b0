// SPDX-License-Identifier: Apache-2.0
// What the stages of the CPU rasteriser share.
#pragma once

#include <algorithm>
#include <cmath>

#include "stgs/format/raster.h"

namespace stgs::raster {

// Pixels [x0,x1) x [y0,y1).
struct PixelBox {
  int x0, y0, x1, y1;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
};

// First pixel whose centre is at or after `edge`, kept in [low, high].
inline int first_pixel(float edge, int low, int high) {
  const float x = std::ceil(edge - 0.5f);
  return static_cast<int>(std::clamp(x, static_cast<float>(low), static_cast<float>(high)));
}

// Pixels of `within` whose centres lie in the splat's box.
inline PixelBox covered_pixels(const Splat& s, PixelBox within) {
  PixelBox box;
  box.x0 = first_pixel(s.mean.x - s.extent.x, within.x0, within.x1);
  box.y0 = first_pixel(s.mean.y - s.extent.y, within.y0, within.y1);
  // One past the last centre that is not after the far edge.
  box.x1 =
      static_cast<int>(std::clamp(std::floor(s.mean.x + s.extent.x + 0.5f),
                                  static_cast<float>(within.x0), static_cast<float>(within.x1)));
  box.y1 =
      static_cast<int>(std::clamp(std::floor(s.mean.y + s.extent.y + 0.5f),
                                  static_cast<float>(within.y0), static_cast<float>(within.y1)));
  return box;
}

// Pixels of a tile, cut at the image's edge.
inline PixelBox tile_pixels(const SplatFrame& frame, int tile) {
  const int tx = tile % frame.tiles_x, ty = tile / frame.tiles_x;
  return {tx * kTileSize, ty * kTileSize, std::min((tx + 1) * kTileSize, frame.width),
          std::min((ty + 1) * kTileSize, frame.height)};
}

// Blends one tile: the reference, and the machine's vector unit.
void blend_tile_scalar(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);

}  // namespace stgs::raster
