// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/raster.h"

#include <algorithm>
#include <cmath>

#include "raster/frame_memory.h"

namespace stgs {

void Image::reshape(int w, int h, int c) {
  width = w;
  height = h;
  channels = c;
  raster::resize(data, static_cast<std::size_t>(w) * h * c, nullptr, "an image");
}

void begin_frame(const math::PinholeCamera& camera, SplatFrame& frame) {
  frame.width = static_cast<int>(std::lround(camera.width));
  frame.height = static_cast<int>(std::lround(camera.height));
  frame.tiles_x = (frame.width + kTileSize - 1) / kTileSize;
  frame.tiles_y = (frame.height + kTileSize - 1) / kTileSize;
  frame.splats.clear();
  frame.instances.clear();
  raster::resize(frame.tile_begin, static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y + 1,
                 frame.memory, "the tiles of the image");
  std::fill(frame.tile_begin.begin(), frame.tile_begin.end(), 0u);
}

void render(const Gaussians4D& set, double t, const math::PinholeCamera& camera,
            const RasterSettings& settings, SplatFrame& frame, RasterOutput& output) {
  begin_frame(camera, frame);
  slice(set, t, camera, settings, 0, frame);
  bin(frame);
  blend(frame, settings, output);
}

}  // namespace stgs
