// SPDX-License-Identifier: Apache-2.0
#include "train/importance.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {
namespace {

math::PinholeCamera half_size(math::PinholeCamera camera) {
  camera.width = std::max(1.0f, std::floor(0.5f * camera.width));
  camera.height = std::max(1.0f, std::floor(0.5f * camera.height));
  for (float* v : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *v *= 0.5f;
  return camera;
}

// Adds the squares of a pixel's weights to those of its tile's instances.
void add_pixel(const SplatFrame& frame, std::uint32_t begin, std::uint32_t end, math::Vec2 pixel,
               std::vector<float>& by_instance) {
  float transmittance = 1.0f;
  for (std::uint32_t k = begin; k < end && transmittance > math::kTransmittanceMin; ++k) {
    const Splat& splat = frame.splats[frame.instances[k]];
    const float power =
        math::splat_power(splat.conic, pixel.x - splat.mean.x, pixel.y - splat.mean.y);
    const float alpha = math::splat_alpha(splat.opacity, power);
    const float weight = alpha * transmittance;
    by_instance[k] += weight * weight;
    transmittance *= 1.0f - alpha;
  }
}

void add_view(const SplatFrame& frame, std::vector<float>& by_instance,
              std::vector<float>& importance) {
  by_instance.assign(frame.instances.size(), 0.0f);
  const auto tiles = static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y;
  parallel_for(std::size_t{0}, tiles, [&](std::size_t tile) {
    const int x0 = static_cast<int>(tile % frame.tiles_x) * kTileSize;
    const int y0 = static_cast<int>(tile / frame.tiles_x) * kTileSize;
    for (int y = y0; y < std::min(frame.height, y0 + kTileSize); ++y) {
      for (int x = x0; x < std::min(frame.width, x0 + kTileSize); ++x) {
        add_pixel(frame, frame.tile_begin[tile], frame.tile_begin[tile + 1],
                  {static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f}, by_instance);
      }
    }
  });
  // In the order of the lists, whatever threads did the tiles.
  for (std::size_t k = 0; k < by_instance.size(); ++k) {
    importance[frame.splats[frame.instances[k]].id] += by_instance[k];
  }
}

}  // namespace

std::vector<float> view_importance(const Gaussians4D& set, const PreparedCapture& capture,
                                   int views) {
  std::vector<math::PinholeCamera> cameras;
  for (const Camera& camera : capture.cameras) {
    if (!camera.test) cameras.push_back(half_size(camera.pinhole(capture.near_plane)));
  }
  std::vector<float> importance(set.size(), 0.0f), by_instance;
  if (cameras.empty()) return importance;
  SplatFrame frame;
  for (int v = 0; v < views; ++v) {
    // Cameras in turn; frames evenly, each camera at others.
    const math::PinholeCamera& camera = cameras[static_cast<std::size_t>(v) % cameras.size()];
    const double moment = (v + 0.5) / views * capture.frames;
    begin_frame(camera, frame);
    slice(set, static_cast<float>(std::floor(moment)), camera, {}, 0, frame);
    bin(frame);
    add_view(frame, by_instance, importance);
  }
  return importance;
}

}  // namespace stgs::encoder
