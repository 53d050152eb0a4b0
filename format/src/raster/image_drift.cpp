// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/image_drift.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"
#include "stgs/format/scene_statistics.h"

namespace stgs {
namespace {

constexpr float kNotCovered = -1.0f;

bool inside(const math::PinholeCamera& camera, math::Vec2 pixel) {
  return pixel.x >= 0 && pixel.y >= 0 && pixel.x < camera.width && pixel.y < camera.height;
}

// Returns the centre of a primitive at a time of its part.
math::Vec3 centre_at(const Gaussians4D& set, std::size_t i, double ticks) {
  const float* x = &set.position[3 * i];
  const float* u = &set.velocity[3 * i];
  return math::position_at({x[0], x[1], x[2]}, {u[0], u[1], u[2]},
                           static_cast<float>(ticks - set.time[i]));
}

// Returns the distance in pixels between the projections of two points, or kNotCovered.
float distance_in(const math::PinholeCamera& camera, math::Vec3 first, math::Vec3 last) {
  const math::Projection p =
      math::project_gaussian(camera, first, {}, math::screen_blur(math::kDilated));
  const math::Projection q =
      math::project_gaussian(camera, last, {}, math::screen_blur(math::kDilated));
  if (p.visible == 0 || q.visible == 0) return kNotCovered;
  if (!inside(camera, p.mean) && !inside(camera, q.mean)) return kNotCovered;
  return std::hypot(p.mean.x - q.mean.x, p.mean.y - q.mean.y);
}

// Returns the mean drift over the cameras that cover primitive i, or kNotCovered.
double drift_of(const Scene& scene, const ShownFrames& frames, std::size_t i,
                const std::vector<math::PinholeCamera>& cameras) {
  const math::Vec3 first = centre_at(scene.gaussians, i, frames.first - frames.part_begin);
  const math::Vec3 last = centre_at(scene.gaussians, i, frames.last - frames.part_begin);
  double sum = 0;
  int count = 0;
  for (const math::PinholeCamera& camera : cameras) {
    const float distance = distance_in(camera, first, last);
    if (!(distance >= 0)) continue;
    sum += distance;
    ++count;
  }
  return count == 0 ? double{kNotCovered} : sum / count;
}

// Returns the number of cameras that cover primitive i, counted up to 2.
std::uint8_t cameras_covering(const Scene& scene, const ShownFrames& frames, std::size_t i,
                              const std::vector<math::PinholeCamera>& cameras) {
  const double nearest =
      std::clamp(static_cast<double>(scene.gaussians.time[i]), frames.first - frames.part_begin,
                 frames.last - frames.part_begin);
  const math::Vec3 centre = centre_at(scene.gaussians, i, nearest);
  std::uint8_t count = 0;
  for (const math::PinholeCamera& camera : cameras) {
    const math::Projection p =
        math::project_gaussian(camera, centre, {}, math::screen_blur(math::kDilated));
    if (p.visible != 0 && inside(camera, p.mean) && ++count == 2) break;
  }
  return count;
}

}  // namespace

ImageDrift image_drift(const Scene& scene, const std::vector<math::PinholeCamera>& cameras) {
  const Gaussians4D& set = scene.gaussians;
  const ShownFrameTable table(scene);
  std::vector<double> drifts(set.size(), double{kNotCovered});
  parallel_blocks(std::size_t{0}, set.size(), std::size_t{4096},
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t i = first; i < last; ++i) {
                      if (table.covers_clip(i))
                        drifts[i] = drift_of(scene, table.frames(i), i, cameras);
                    }
                  });
  ImageDrift out;
  double weights = 0;
  std::vector<double> covered;
  for (std::size_t i = 0; i < set.size(); ++i) {
    if (!(drifts[i] >= 0)) continue;
    const double opacity = math::opacity_of(set.opacity_logit[i]);
    covered.push_back(drifts[i]);
    out.mean += drifts[i];
    out.opacity_weighted += opacity * drifts[i];
    weights += opacity;
    if (drifts[i] <= kStaticDrift) ++out.within_bound;
  }
  out.primitives = covered.size();
  if (covered.empty()) return out;
  out.mean /= static_cast<double>(covered.size());
  out.opacity_weighted /= weights;  // above 0: opacities are at least the threshold
  const auto middle = covered.begin() + static_cast<std::ptrdiff_t>(covered.size() / 2);
  std::nth_element(covered.begin(), middle, covered.end());
  out.median = *middle;
  return out;
}

CameraCoverage camera_coverage(const Scene& scene,
                               const std::vector<math::PinholeCamera>& cameras) {
  const Gaussians4D& set = scene.gaussians;
  const ShownFrameTable table(scene);
  std::vector<std::uint8_t> counts(set.size(), 0);  // up to 2
  parallel_blocks(std::size_t{0}, set.size(), std::size_t{4096},
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t i = first; i < last; ++i)
                      counts[i] = cameras_covering(scene, table.frames(i), i, cameras);
                  });
  CameraCoverage out;
  for (const std::uint8_t count : counts) {
    ++(count == 0 ? out.by_none : count == 1 ? out.by_one : out.by_more);
  }
  return out;
}

}  // namespace stgs
