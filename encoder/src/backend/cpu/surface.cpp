// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/surface.h"

#include <utility>

#include "backend/cpu/block.h"
#include "math/grad.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_view.h"

namespace stgs::encoder::cpu {
namespace {

using namespace math;
using raster::read3;

// Splats per task.

template <typename Work>
void for_each_splat(const SplatFrame& frame, Work work) {
  parallel_blocks(std::size_t{0}, frame.splats.size(), kBlock,
                  [&](std::size_t first, std::size_t last) {
                    for (std::size_t s = first; s < last; ++s) work(s, frame.splats[s].id);
                  });
}

Quat rotation_at(const Gaussians4D& set, std::size_t i) {
  const float* r = &set.rotation[4 * i];
  return {r[0], r[1], r[2], r[3]};
}

Vec3 position_of(const Gaussians4D& set, std::size_t i, float t) {
  return position_at(read3(set.position, i), read3(set.velocity, i), t - set.time[i]);
}

void swap_attributes(SplatFrame& frame, std::vector<Plane>& planes) {
  for_each_splat(frame, [&](std::size_t s, std::size_t) {
    std::swap(frame.splats[s].colour, planes[s].normal);
    std::swap(frame.splats[s].depth, planes[s].distance);
  });
}

}  // namespace

void find_planes(const Gaussians4D& set, float t, const PinholeCamera& camera,
                 const SplatFrame& frame, std::vector<Plane>& planes) {
  planes.resize(frame.splats.size());
  for_each_splat(frame, [&](std::size_t s, std::size_t i) {
    planes[s] = primitive_plane(camera, position_of(set, i, t), rotation_at(set, i),
                                read3(set.log_scale, i));
  });
}

void blend_planes(const RasterSettings& settings, SplatFrame& frame, std::vector<Plane>& planes,
                  RasterOutput& output) {
  RasterSettings no_background = settings;
  no_background.background = {0.0f, 0.0f, 0.0f};
  swap_attributes(frame, planes);
  blend(frame, no_background, output);
  swap_attributes(frame, planes);
}

void planes_backward(const Gaussians4D& set, float t, const PinholeCamera& camera,
                     const SplatFrame& frame, const std::vector<Plane>& d_planes,
                     PrimitiveGradients& out) {
  for_each_splat(frame, [&](std::size_t s, std::size_t i) {
    const PrimitivePlaneGrad by = primitive_plane_grad(
        camera, position_of(set, i, t), rotation_at(set, i), read3(set.log_scale, i), d_planes[s]);
    const MotionGrad motion =
        position_at_grad(read3(set.velocity, i), t - set.time[i], by.position);
    const auto add = [](float* to, Vec3 v) {
      to[0] += v.x;
      to[1] += v.y;
      to[2] += v.z;
    };
    add(&out.position[3 * s], motion.position);
    add(&out.velocity[3 * s], motion.u);
    out.time[s] -= motion.dt;
    out.rotation[4 * s] += by.rotation.w;
    add(&out.rotation[4 * s + 1], {by.rotation.x, by.rotation.y, by.rotation.z});
  });
}

}  // namespace stgs::encoder::cpu
