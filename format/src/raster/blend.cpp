// SPDX-License-Identifier: Apache-2.0
// Blending tile by tile. The scalar kernel is the reference rendering.
#include <cmath>
#include <numeric>

#include "raster/frame_memory.h"
#include "raster/tile_work.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/fovea.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace raster {

namespace {

// List entries that are converted to half resolution at a time, 68 bytes each.
constexpr int kHalvedAtOnce = 1024;

bool at_half_resolution(const RasterSettings& settings, const PixelBox& tile) {
  if (!settings.fovea) return false;
  const auto square = [](int edge) {
    const int begin = edge / math::kFoveaSquare * math::kFoveaSquare;
    return static_cast<float>(begin);
  };
  return math::beyond_fovea(settings.fovea->centre, settings.fovea->radius, square(tile.x0),
                            square(tile.y0));
}

Splat halved(const Splat& s) {
  const math::HalvedSplat shape = math::halved_splat(s.conic);
  Splat out = s;
  out.mean = {0.5f * s.mean.x, 0.5f * s.mean.y};
  out.conic = shape.conic;
  out.opacity = s.opacity * shape.scale;
  // Half the box, widened by a variance of 1/16 pixels^2, whatever the splat's own variance.
  const float reach = 2.0f * std::max(s.reach, 1e-6f);
  const auto extent = [reach](float full) { return 0.5f * std::sqrt(full * full + 0.25f * reach); };
  out.extent = {extent(s.extent.x), extent(s.extent.y)};
  out.reach = std::log(std::max(out.opacity / math::kAlphaThreshold, 1e-30f));
  return out;
}

}  // namespace

TileWork::TileWork(const SplatFrame& frame, const RasterSettings& settings, int tile)
    : pixels(tile_pixels(frame, tile)),
      box(pixels),
      count(static_cast<int>(frame.tile_begin[tile + 1] - frame.tile_begin[tile])),
      all_(frame.splats.data()),
      entries_(frame.instances.data() + frame.tile_begin[tile]) {
  if (!at_half_resolution(settings, pixels)) return;
  halvings = 1;
  box = {pixels.x0 / 2, pixels.y0 / 2, (pixels.x1 + 1) / 2, (pixels.y1 + 1) / 2};
}

const Splat& TileWork::entry(int k, Splat& memory) const {
  const Splat& splat = all_[entries_[k]];
  if (halvings == 0) return splat;
  memory = halved(splat);
  return memory;
}

int TileWork::load(int first) {
  if (halvings == 0) {
    splats = all_;
    list = entries_ + first;
    return count - first;
  }
  const int n = std::min(count - first, kHalvedAtOnce);
  halved_.resize(static_cast<std::size_t>(n));
  for (int k = 0; k < n; ++k) entry(first + k, halved_[static_cast<std::size_t>(k)]);
  numbers_.resize(halved_.size());
  std::iota(numbers_.begin(), numbers_.end(), 0u);
  splats = halved_.data();
  list = numbers_.data();
  return n;
}

namespace {

// Sums of a pixel.
struct Gathered {
  float transmittance = 1.0f, depth = 0.0f;
  math::Vec3 colour{0.0f, 0.0f, 0.0f};
  std::uint32_t last = 0;
};

Gathered gather(const TileWork& tile, int x, int y) {
  Gathered out;
  Splat memory;
  for (int k = 0; k < tile.count; ++k) {
    const Splat& s = tile.entry(k, memory);
    const float power = math::splat_power(s.conic, static_cast<float>(x) + 0.5f - s.mean.x,
                                          static_cast<float>(y) + 0.5f - s.mean.y);
    const float alpha = math::splat_alpha(s.opacity, power);
    if (alpha == 0.0f) continue;
    const float next = out.transmittance * (1.0f - alpha);
    if (next < math::kTransmittanceMin) break;
    const float weight = alpha * out.transmittance;
    out.colour.x += weight * s.colour.x;
    out.colour.y += weight * s.colour.y;
    out.colour.z += weight * s.colour.z;
    out.depth += weight * s.depth;
    out.transmittance = next;
    out.last = static_cast<std::uint32_t>(k) + 1;
  }
  return out;
}

void write_pixel(const Gathered& pixel, std::size_t p, const RasterSettings& settings,
                 RasterOutput& output) {
  const float alpha = 1.0f - pixel.transmittance;
  output.colour.plane(0)[p] = pixel.colour.x + pixel.transmittance * settings.background.x;
  output.colour.plane(1)[p] = pixel.colour.y + pixel.transmittance * settings.background.y;
  output.colour.plane(2)[p] = pixel.colour.z + pixel.transmittance * settings.background.z;
  output.alpha.data[p] = alpha;
  output.depth.data[p] = alpha > 0.0f ? pixel.depth / alpha : 0.0f;
  output.transmittance.data[p] = pixel.transmittance;
  output.last[p] = pixel.last;
}

}  // namespace

void blend_tile_scalar(const SplatFrame& frame, const RasterSettings& settings, int tile_index,
                       RasterOutput& output) {
  const TileWork tile(frame, settings, tile_index);
  const int side = 1 << tile.halvings;
  for (int y = tile.box.y0; y < tile.box.y1; ++y) {
    for (int x = tile.box.x0; x < tile.box.x1; ++x) {
      const Gathered pixel = gather(tile, x, y);
      const int end_x = std::min((x + 1) * side, tile.pixels.x1);
      const int end_y = std::min((y + 1) * side, tile.pixels.y1);
      for (int py = y * side; py < end_y; ++py) {
        for (int px = x * side; px < end_x; ++px) {
          write_pixel(pixel, static_cast<std::size_t>(py) * frame.width + px, settings, output);
        }
      }
    }
  }
}

}  // namespace raster

void blend(const SplatFrame& frame, const RasterSettings& settings, RasterOutput& output) {
  output.colour.reshape(frame.width, frame.height, 3);
  output.alpha.reshape(frame.width, frame.height, 1);
  output.depth.reshape(frame.width, frame.height, 1);
  output.transmittance.reshape(frame.width, frame.height, 1);
  raster::resize(output.last, static_cast<std::size_t>(frame.width) * frame.height, nullptr,
                 "an image");
  const auto blend_tile = settings.scalar ? raster::blend_tile_scalar : raster::blend_tile_vector;
  parallel_for(0, frame.tiles_x * frame.tiles_y,
               [&](int tile) { blend_tile(frame, settings, tile, output); });
}

std::string vector_target() {
  return raster::blend_vector_target();
}

}  // namespace stgs
