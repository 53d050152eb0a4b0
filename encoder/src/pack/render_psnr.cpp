// SPDX-License-Identifier: Apache-2.0
#include "pack/render_psnr.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include "stgs/encoder/metrics.h"
#include "stgs/format/math/surface.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster.h"

namespace stgs::encoder {
namespace {

constexpr float kMaxSide = 1280.0f;  // pixels
constexpr float kYaw = 0.14f;        // radians: 8 degrees
constexpr float kPitch = 0.07f;

// Working memory of a render.
struct RenderBuffers {
  SplatFrame frame;
  RasterOutput output;
};

// Renders the scene at t: the primitives of the parts that are displayed at this time.
void render_scene(const Scene& scene, double t, const math::PinholeCamera& camera,
                  RenderBuffers& buffers) {
  RasterSettings settings;
  const float* b = scene.metadata.background;
  settings.background = {b[0], b[1], b[2]};
  settings.kernel = scene.metadata.kernel;
  begin_frame(camera, buffers.frame);
  if (scene.parts.empty()) slice(scene.gaussians, t, camera, settings, 0, buffers.frame);
  std::uint32_t first = 0;
  for (const ScenePart& part : scene.parts) {
    std::vector<std::uint32_t> members(part.primitives);
    std::iota(members.begin(), members.end(), first);
    first += static_cast<std::uint32_t>(part.primitives);
    if (!part.shows(t, scene.metadata.frames)) continue;
    slice(scene.gaussians, members, t - part.begin_ticks, camera, settings, 0, buffers.frame);
  }
  bin(buffers.frame);
  blend(buffers.frame, settings, buffers.output);
  for (float& v : buffers.output.colour.data) v = std::clamp(v, 0.0f, 1.0f);
}

math::PinholeCamera limit_size(math::PinholeCamera camera, float side) {
  const float scale = side / std::max(camera.width, camera.height);
  if (scale >= 1.0f) return camera;
  for (float* v : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) *v *= scale;
  for (float* v : {&camera.width, &camera.height}) *v = std::max(1.0f, std::floor(scale * *v));
  return camera;
}

// Returns the median depth of the pixels with alpha above 0.5.
float depth_in_view(const RasterOutput& output, float near_plane) {
  std::vector<float> depths;
  for (std::size_t i = 0; i < output.depth.data.size(); ++i) {
    if (output.alpha.data[i] > 0.5f) depths.push_back(output.depth.data[i]);
  }
  if (depths.empty()) return 10.0f * near_plane;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

// Orbits the camera about its own axes around the point at `depth` in front of it.
math::PinholeCamera orbit(math::PinholeCamera camera, float yaw, float pitch, float depth) {
  const float cy = std::cos(yaw), sy = std::sin(yaw), cp = std::cos(pitch), sp = std::sin(pitch);
  const math::Mat3 rotation = {cy, 0.0f, sy, sp * sy, cp, -sp * cy, -cp * sy, sp, cp * cy};
  const auto rotated = [&](int column) {
    return math::mat3_mul(rotation, math::mat3_column(camera.rotation, column));
  };
  camera.rotation = math::mat3_of_columns(rotated(0), rotated(1), rotated(2));
  const math::Vec3 t = camera.translation;
  camera.translation = math::mat3_mul(rotation, {t.x, t.y, t.z - depth});
  camera.translation.z += depth;
  return camera;
}

}  // namespace

std::optional<double> render_psnr(const Scene& scene, const Scene& packed) {
  const SceneMetadata& metadata = scene.metadata;
  if (!metadata.start_camera) return std::nullopt;
  const auto start = limit_size(pinhole_of(*metadata.start_camera, metadata.near_plane), kMaxSide);
  // Each start view and the orbited one after it, which depends on its depth.
  std::array<double, kPsnrImages / 2> errors{};
  parallel_for(0, kPsnrImages / 2, [&](int pair) {
    RenderBuffers before, after;
    float depth = 0.0f;
    for (int i = 2 * pair; i < 2 * pair + 2; ++i) {
      const double time = (i + 0.5) / kPsnrImages * scene.metadata.frames;
      const double t = std::floor(time);
      const float side = pair % 2 == 0 ? 1.0f : -1.0f;
      const bool orbited = i % 2 == 1;
      const auto camera =
          orbited ? orbit(start, side * kYaw, (i / 4 == 0 ? kPitch : -kPitch), depth) : start;
      render_scene(scene, t, camera, before);
      if (!orbited) depth = depth_in_view(before.output, start.near_plane);
      render_scene(packed, t, camera, after);
      errors[pair] += mean_squared_error(before.output.colour, after.output.colour) / kPsnrImages;
    }
  });
  return psnr_of(std::accumulate(errors.begin(), errors.end(), 0.0));
}

}  // namespace stgs::encoder
