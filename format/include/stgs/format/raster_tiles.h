// SPDX-License-Identifier: Apache-2.0
// The pixels of a tile, and those that a splat may touch. Shared by the stages of the rasteriser
// and the encoder's backward pass.
#pragma once

#include <algorithm>

#include "stgs/format/raster.h"

namespace stgs::raster {

// Pixels [x0,x1) x [y0,y1).
struct PixelBox {
  int x0, y0, x1, y1;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
};

// Returns the first pixel whose centre is at or after `edge`, clamped to [low, high]; low >= 0.
inline int first_pixel(float edge, int low, int high) {
  const float x = std::clamp(edge - 0.5f, static_cast<float>(low), static_cast<float>(high));
  const int i = static_cast<int>(x);
  return static_cast<float>(i) < x ? i + 1 : i;
}

// Returns one past the last pixel whose centre is not after `edge`, clamped to [low, high]; low >=
// 0.
inline int end_pixel(float edge, int low, int high) {
  return static_cast<int>(
      std::clamp(edge + 0.5f, static_cast<float>(low), static_cast<float>(high)));
}

// Returns the pixels of `within` whose centres lie in the splat's box.
inline PixelBox covered_pixels(const Splat& s, PixelBox within) {
  return {first_pixel(s.mean.x - s.extent.x, within.x0, within.x1),
          first_pixel(s.mean.y - s.extent.y, within.y0, within.y1),
          end_pixel(s.mean.x + s.extent.x, within.x0, within.x1),
          end_pixel(s.mean.y + s.extent.y, within.y0, within.y1)};
}

// Returns the pixels of a tile, clipped to the image.
inline PixelBox tile_pixels(const SplatFrame& frame, int tile) {
  const int tx = tile % frame.tiles_x, ty = tile / frame.tiles_x;
  return {tx * kTileSize, ty * kTileSize, std::min((tx + 1) * kTileSize, frame.width),
          std::min((ty + 1) * kTileSize, frame.height)};
}

}  // namespace stgs::raster
