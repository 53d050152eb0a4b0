// SPDX-License-Identifier: Apache-2.0
// The blend's kernels: the reference, and the machine's vector unit.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/raster_tiles.h"

namespace stgs::raster {

// What a tile is drawn from: at half resolution (RasterSettings::fovea) as a tile of a picture of
// half the size, 8 x 8 of its pixels.
class TileWork {
 public:
  TileWork(const SplatFrame& frame, const RasterSettings& settings, int tile);

  PixelBox pixels;      // of the picture, which are written
  PixelBox box;         // of what is drawn: the same, or of the picture of half the size
  int halvings = 0;     // 0 or 1
  const Splat* splats;  // as box sees them
  const std::uint32_t* list;
  int count;

 private:
  std::vector<Splat> halved_;
  std::vector<std::uint32_t> numbers_;
};

void blend_tile_scalar(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);
void blend_tile_vector(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);
std::string blend_vector_target();

}  // namespace stgs::raster
