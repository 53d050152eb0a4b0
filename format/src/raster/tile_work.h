// SPDX-License-Identifier: Apache-2.0
// The blending kernels: scalar reference and vector unit.
#pragma once

#include <string>
#include <vector>

#include "stgs/format/raster_tiles.h"

namespace stgs::raster {

// The input of blending a tile. At half resolution (RasterSettings::fovea) it is a tile of an image
// of half the size, with 8 x 8 pixels, and a few of its splats are converted at a time.
class TileWork {
 public:
  TileWork(const SplatFrame& frame, const RasterSettings& settings, int tile);

  // Returns entry k of the tile's list in the coordinates of `box`. `memory` holds the result at
  // half resolution.
  const Splat& entry(int k, Splat& memory) const;
  // Makes entries from `first` on available in `splats` and `list`. Returns their number.
  int load(int first);

  PixelBox pixels;   // pixels of the output image to write
  PixelBox box;      // pixels to render: the same, or those of the half-size image
  int halvings = 0;  // 0 or 1
  int count;         // entries of the tile's list
  // The loaded entries.
  const Splat* splats = nullptr;  // in the coordinates of `box`
  const std::uint32_t* list = nullptr;

 private:
  const Splat* all_;              // of the frame
  const std::uint32_t* entries_;  // of the tile's list
  std::vector<Splat> halved_;
  std::vector<std::uint32_t> numbers_;
};

void blend_tile_scalar(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);
void blend_tile_vector(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output);
// Returns the name of the instruction set of blend_tile_vector().
std::string blend_vector_target();

}  // namespace stgs::raster
