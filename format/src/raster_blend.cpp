// SPDX-License-Identifier: Apache-2.0
// Blending, tile by tile; the scalar kernel is the reference rendering.

#include "raster_internal.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace raster {

void blend_tile_scalar(const SplatFrame& frame, const RasterSettings& settings, int tile,
                       RasterOutput& output) {
  const PixelBox box = tile_pixels(frame, tile);
  const std::uint32_t* list = frame.instances.data() + frame.tile_begin[tile];
  const std::uint32_t count = frame.tile_begin[tile + 1] - frame.tile_begin[tile];
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      float transmittance = 1.0f, depth = 0.0f;
      math::Vec3 colour{0.0f, 0.0f, 0.0f};
      std::uint32_t last = 0;
      for (std::uint32_t k = 0; k < count; ++k) {
        const Splat& s = frame.splats[list[k]];
        const float power = math::splat_power(s.conic, static_cast<float>(x) + 0.5f - s.mean.x,
                                              static_cast<float>(y) + 0.5f - s.mean.y);
        const float alpha = math::splat_alpha(s.opacity, power);
        if (alpha == 0.0f) continue;
        const float next = transmittance * (1.0f - alpha);
        if (next < math::kTransmittanceMin) break;
        const float weight = alpha * transmittance;
        colour.x += weight * s.colour.x;
        colour.y += weight * s.colour.y;
        colour.z += weight * s.colour.z;
        depth += weight * s.depth;
        transmittance = next;
        last = k + 1;
      }
      const std::size_t p = static_cast<std::size_t>(y) * frame.width + x;
      const float alpha = 1.0f - transmittance;
      output.colour.plane(0)[p] = colour.x + transmittance * settings.background.x;
      output.colour.plane(1)[p] = colour.y + transmittance * settings.background.y;
      output.colour.plane(2)[p] = colour.z + transmittance * settings.background.z;
      output.alpha.data[p] = alpha;
      output.depth.data[p] = alpha > 0.0f ? depth / alpha : 0.0f;
      output.transmittance.data[p] = transmittance;
      output.last[p] = last;
    }
  }
}

}  // namespace raster

void blend(const SplatFrame& frame, const RasterSettings& settings, RasterOutput& output) {
  output.colour.reshape(frame.width, frame.height, 3);
  output.alpha.reshape(frame.width, frame.height, 1);
  output.depth.reshape(frame.width, frame.height, 1);
  output.transmittance.reshape(frame.width, frame.height, 1);
  output.last.resize(static_cast<std::size_t>(frame.width) * frame.height);
  const auto blend_tile = settings.scalar ? raster::blend_tile_scalar : raster::blend_tile_vector;
  parallel_for(0, frame.tiles_x * frame.tiles_y,
               [&](int tile) { blend_tile(frame, settings, tile, output); });
}

std::string vector_target() {
  return raster::blend_vector_target();
}

}  // namespace stgs
