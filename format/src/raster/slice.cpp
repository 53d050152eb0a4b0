// SPDX-License-Identifier: Apache-2.0
// Slicing at time t: motion, visibility, culling, projection and colour of each primitive.

#include <algorithm>
#include <cmath>

#include "raster/frame_memory.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/screen_splat.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_view.h"

namespace stgs {
namespace {

using namespace math;
using raster::read3;
using raster::View;

// Primitives per block, the unit of parallel work. Results are concatenated in block order.
constexpr std::size_t kBlock = 1024;
// Blocks that are sliced before their results are concatenated: results of at most 64 MiB.
constexpr std::size_t kMaxBlocks = 1024;

// Evaluates the SH. Returns false if the distance or a sum is not finite (representation 4.6).
bool colour_of(const float* sh, int coefficients, Vec3 from_camera, Vec3& colour) {
  const float square = dot3(from_camera, from_camera);
  const float n = 1.0f / std::sqrt(square);
  const ShBasis basis = sh_basis({from_camera.x * n, from_camera.y * n, from_camera.z * n});
  Vec3 sum{0, 0, 0};
  for (int k = 0; k < coefficients; ++k) {
    sum.x += basis.v[k] * sh[3 * k];
    sum.y += basis.v[k] * sh[3 * k + 1];
    sum.z += basis.v[k] * sh[3 * k + 2];
  }
  colour = {sh_colour(sum.x), sh_colour(sum.y), sh_colour(sum.z)};
  return std::isfinite(square) && std::isfinite(sum.x) && std::isfinite(sum.y) &&
         std::isfinite(sum.z);
}

// Returns whether a ball around the Gaussian at camera point c projects outside the image. Takes
// one exponential; the exact test needs the covariance.
bool surely_outside(const PinholeCamera& camera, Vec3 c, float log_scale_max) {
  const ProjectionRows rows = projection_rows(camera, c);
  const float s = std::exp(log_scale_max);
  // 2.02: twice the largest reach, plus one percent for rounding.
  const float q = 2.02f * kReachMax;
  const Vec2 extent{std::sqrt(q * (s * s * dot3(rows.u, rows.u) + screen_blur(kDilated))),
                    std::sqrt(q * (s * s * dot3(rows.v, rows.v) + screen_blur(kDilated)))};
  const Vec2 mean{camera.fx * c.x / c.z + camera.cx, camera.fy * c.y / c.z + camera.cy};
  return outside_image(camera, mean, extent);
}

// Computes the splat of primitive i, cheapest tests first. Returns false if it is not visible.
bool make_splat(const Gaussians4D& set, std::size_t i, const View& view, Splat& out) {
  const auto dt = static_cast<float>(view.t - set.time[i]);
  const float sigma = set.sigma[i], radius = set.radius[i];
  const float beyond = std::abs(dt) - radius;
  if (beyond > 0.0f && beyond * beyond > kReachMax * sigma * sigma) return false;
  const Vec3 position = position_at(read3(set.position, i), read3(set.velocity, i), dt);
  const Vec3 c = to_camera(view.camera, position);
  if (!(c.z >= view.camera.near_plane)) return false;
  const float* log_scale = &set.log_scale[3 * i];
  if (surely_outside(view.camera, c, std::max({log_scale[0], log_scale[1], log_scale[2]})))
    return false;
  const float opacity_t = opacity_of(set.opacity_logit[i]) * visibility(dt, sigma, radius);
  if (!(opacity_t >= kAlphaThreshold)) return false;

  const float* r = &set.rotation[4 * i];
  const Sym3 covariance =
      covariance_of({r[0], r[1], r[2], r[3]},
                    {std::exp(log_scale[0]), std::exp(log_scale[1]), std::exp(log_scale[2])});
  const Projection p =
      project_gaussian(view.camera, position, covariance, screen_blur(view.kernel));
  const float opacity = splat_opacity(view.kernel, opacity_t, p);
  const SplatBox box = splat_box(view.camera, p, opacity);
  if (!box.visible) return false;

  out.mean = p.mean;
  out.conic = p.conic;
  out.extent = box.extent;
  out.opacity = opacity;
  out.depth = p.depth;
  out.reach = std::log(opacity / kAlphaThreshold);
  return colour_of(
      &set.sh[i * view.stride], view.coefficients,
      {position.x - view.centre.x, position.y - view.centre.y, position.z - view.centre.z},
      out.colour);
}

// Ensures that there are n blocks, each of which may hold kBlock splats.
void ensure_blocks(SplatFrame& frame, std::size_t n) {
  auto& blocks = frame.scratch.slice_blocks;
  if (blocks.size() >= n) return;
  blocks.reserve(n);
  raster::charge(frame.memory, (n - blocks.size()) * kBlock * sizeof(Splat), "the splats");
  blocks.resize(n);
}

// Appends the splats of the first n blocks to those of the frame.
void append_blocks(SplatFrame& frame, std::size_t n) {
  const auto& blocks = frame.scratch.slice_blocks;
  std::size_t total = frame.splats.size();
  for (std::size_t b = 0; b < n; ++b) total += blocks[b].size();
  raster::reserve(frame.splats, total, frame.memory, "the splats");
  for (std::size_t b = 0; b < n; ++b)
    frame.splats.insert(frame.splats.end(), blocks[b].begin(), blocks[b].end());
}

// Slices the `count` primitives index(0) < index(1) < ... and appends the visible ones in order.
template <typename Index>
void slice_indexed(const Gaussians4D& set, std::size_t count, Index index, double t,
                   const PinholeCamera& camera, const RasterSettings& settings,
                   std::uint32_t id_base, SplatFrame& frame) {
  const View view = raster::view_of(set, t, camera, settings);
  const std::size_t blocks = (count + kBlock - 1) / kBlock;
  auto& found = frame.scratch.slice_blocks;
  for (std::size_t first = 0; first < blocks; first += kMaxBlocks) {
    const std::size_t n = std::min(kMaxBlocks, blocks - first);
    ensure_blocks(frame, n);
    parallel_for(std::size_t{0}, n, [&](std::size_t b) {
      found[b].clear();
      const std::size_t begin = (first + b) * kBlock, end = std::min(count, begin + kBlock);
      Splat splat;
      for (std::size_t k = begin; k < end; ++k) {
        const std::uint32_t i = index(k);
        if (!make_splat(set, i, view, splat)) continue;
        splat.id = id_base + i;
        found[b].push_back(splat);
      }
    });
    append_blocks(frame, n);
  }
}

}  // namespace

void slice(const Gaussians4D& set, double t, const PinholeCamera& camera,
           const RasterSettings& settings, std::uint32_t id_base, SplatFrame& frame) {
  slice_indexed(
      set, set.size(), [](std::size_t k) { return static_cast<std::uint32_t>(k); }, t, camera,
      settings, id_base, frame);
}

void slice(const Gaussians4D& set, const std::vector<std::uint32_t>& candidates, double t,
           const PinholeCamera& camera, const RasterSettings& settings, std::uint32_t id_base,
           SplatFrame& frame) {
  slice_indexed(
      set, candidates.size(), [&](std::size_t k) { return candidates[k]; }, t, camera, settings,
      id_base, frame);
}

}  // namespace stgs
