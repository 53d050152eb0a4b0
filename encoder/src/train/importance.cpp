// SPDX-License-Identifier: Apache-2.0
#include "train/importance.h"

#include <algorithm>
#include <cmath>

#include "half_size.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {
namespace {

constexpr int kTilePixels = kTileSize * kTileSize;

// Pixels of a tile.
struct TileArea {
  int x0, y0, x1, y1;
};

// The pixels [first, last) of a row, clamped to [low, high), at which a splat's alpha may reach the
// threshold, and one more on each side for rounding.
struct RowSpan {
  int first = 0, last = 0;
};
RowSpan row_span(const Splat& splat, float max_power, float dy, int low, int high) {
  // power(dx) = (xx dx^2 + 2 xy dy dx + yy dy^2) / 2 <= max_power.
  const double a = splat.conic.xx, b = double{splat.conic.xy} * dy;
  const double inside = b * b - a * (double{splat.conic.yy} * dy * dy - 2.0 * max_power);
  if (!(a > 0) || !std::isfinite(inside)) return {low, high};
  if (inside < 0) return {low, low};
  const double half = std::sqrt(inside), mean = splat.mean.x;
  const double from = mean + (-b - half) / a - 1.5, to = mean + (-b + half) / a + 1.5;
  return {static_cast<int>(std::clamp<double>(std::floor(from), low, high)),
          static_cast<int>(std::clamp<double>(std::ceil(to), low, high))};
}

// Returns the sum of a splat's squared blend weights over the pixels of a tile. Updates their
// transmittance; call it front to back.
float add_splat(const Splat& splat, const TileArea& tile, float (&transmittance)[kTilePixels]) {
  // Slightly beyond the power at which alpha equals the threshold.
  const float max_power =
      std::log(std::max(splat.opacity / math::kAlphaThreshold, 1.0f)) * 1.001f + 0.01f;
  float sum = 0;
  for (int y = tile.y0; y < tile.y1; ++y) {
    const float dy = static_cast<float>(y) + 0.5f - splat.mean.y;
    const RowSpan span = row_span(splat, max_power, dy, tile.x0, tile.x1);
    float* const row = transmittance + (y - tile.y0) * kTileSize;
    for (int x = span.first; x < span.last; ++x) {
      float& t = row[x - tile.x0];
      if (!(t > math::kTransmittanceMin)) continue;
      const float dx = static_cast<float>(x) + 0.5f - splat.mean.x;
      const float alpha = math::splat_alpha(splat.opacity, math::splat_power(splat.conic, dx, dy));
      const float weight = alpha * t;
      sum += weight * weight;
      t *= 1.0f - alpha;
    }
  }
  return sum;
}

void add_tile(const SplatFrame& frame, std::size_t number, std::vector<float>& by_instance) {
  const auto tiles_x = static_cast<std::size_t>(frame.tiles_x);
  TileArea tile{};
  tile.x0 = static_cast<int>(number % tiles_x) * kTileSize;
  tile.y0 = static_cast<int>(number / tiles_x) * kTileSize;
  tile.x1 = std::min(frame.width, tile.x0 + kTileSize);
  tile.y1 = std::min(frame.height, tile.y0 + kTileSize);
  float transmittance[kTilePixels];
  std::fill_n(transmittance, kTilePixels, 1.0f);
  constexpr std::uint32_t kCheckInterval = 32;  // splats between checks for opaque tiles
  const auto is_open = [](float t) { return t > math::kTransmittanceMin; };
  for (std::uint32_t k = frame.tile_begin[number]; k < frame.tile_begin[number + 1]; ++k) {
    if (k % kCheckInterval == 0 &&
        std::none_of(transmittance, transmittance + kTilePixels, is_open)) {
      return;
    }
    by_instance[k] = add_splat(frame.splats[frame.instances[k]], tile, transmittance);
  }
}

void add_view(const SplatFrame& frame, std::vector<float>& by_instance,
              std::vector<float>& importance) {
  by_instance.assign(frame.instances.size(), 0.0f);
  const auto tiles = static_cast<std::size_t>(frame.tiles_x) * frame.tiles_y;
  parallel_for(std::size_t{0}, tiles,
               [&](std::size_t tile) { add_tile(frame, tile, by_instance); });
  // In list order, so that the result does not depend on threading.
  for (std::size_t k = 0; k < by_instance.size(); ++k) {
    importance[frame.splats[frame.instances[k]].id] += by_instance[k];
  }
}

// Returns the camera with a wider field of view.
math::PinholeCamera widened(math::PinholeCamera camera) {
  constexpr float kFocal = 0.7f;  // factor of the focal length
  camera.fx *= kFocal;
  camera.fy *= kFocal;
  return camera;
}

}  // namespace

std::vector<ImportanceView> importance_views(const PreparedCapture& capture, int count,
                                             int kernel) {
  std::vector<math::PinholeCamera> cameras;
  for (const Camera& camera : capture.training_cameras())
    cameras.push_back(half_size(camera).pinhole(capture.near_plane));
  // Other viewpoints see more than the training images do.
  const std::size_t trained = cameras.size();
  for (std::size_t i = 0; i < trained; ++i) cameras.push_back(widened(cameras[i]));
  std::vector<ImportanceView> views;
  for (int v = 0; v < count && !cameras.empty(); ++v) {
    // Cycles through the cameras; frames are evenly spaced and differ between cameras.
    const double frame = (v + 0.5) / count * capture.frames;
    views.push_back({cameras[static_cast<std::size_t>(v) % cameras.size()],
                     static_cast<float>(std::floor(frame)), kernel});
  }
  return views;
}

std::optional<std::vector<float>> view_importance(
    const Gaussians4D& set, std::span<const ImportanceView> views,
    const std::function<bool(double)>& should_continue) {
  std::vector<float> importance(set.size(), 0.0f), by_instance;
  SplatFrame frame;
  for (std::size_t v = 0; v < views.size(); ++v) {
    if (!should_continue(static_cast<double>(v) / static_cast<double>(views.size())))
      return std::nullopt;
    begin_frame(views[v].camera, frame);
    RasterSettings settings;
    settings.kernel = views[v].kernel;
    slice(set, views[v].ticks, views[v].camera, settings, 0, frame);
    bin(frame);
    add_view(frame, by_instance, importance);
  }
  return importance;
}

}  // namespace stgs::encoder
