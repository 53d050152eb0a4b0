// SPDX-License-Identifier: Apache-2.0
#include "backend/cpu/project_backward.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "backend/cpu/block.h"
#include "math/camera_grad.h"
#include "math/grad.h"
#include "stgs/format/parallel.h"
#include "stgs/format/raster_view.h"

namespace stgs::encoder::cpu {
namespace {

using namespace math;
using raster::read3;
using raster::View;

void write3(std::span<float> array, std::size_t i, Vec3 v) {
  array[3 * i] = v.x;
  array[3 * i + 1] = v.y;
  array[3 * i + 2] = v.z;
}

// Writes the gradient of the coefficients; returns that of the position at t.
Vec3 colour_backward(const float* sh, const View& view, Vec3 from_camera, Vec3 colour, Vec3 grad,
                     float* by_sh) {
  // A channel that the forward pass clamps at 0 has no gradient.
  if (!(colour.x > 0.0f)) grad.x = 0.0f;
  if (!(colour.y > 0.0f)) grad.y = 0.0f;
  if (!(colour.z > 0.0f)) grad.z = 0.0f;
  const float inverse_length = 1.0f / std::sqrt(dot3(from_camera, from_camera));
  const Vec3 direction = vec3_scale(from_camera, inverse_length);
  const ShBasis basis = sh_basis(direction);
  ShBasis by_basis{};
  for (int k = 0; k < view.coefficients; ++k) {
    by_sh[3 * k] = basis.v[k] * grad.x;
    by_sh[3 * k + 1] = basis.v[k] * grad.y;
    by_sh[3 * k + 2] = basis.v[k] * grad.z;
    by_basis.v[k] = sh[3 * k] * grad.x + sh[3 * k + 1] * grad.y + sh[3 * k + 2] * grad.z;
  }
  if (view.coefficients == 1) return {0.0f, 0.0f, 0.0f};
  return normalise_grad(direction, inverse_length, sh_basis_grad(direction, by_basis));
}

void add_camera(const CameraGrad& by, CameraGrad& sum) {
  sum.rotation = vec3_add(sum.rotation, by.rotation);
  sum.translation = vec3_add(sum.translation, by.translation);
  sum.log_focal += by.log_focal;
  sum.distortion += by.distortion;
  sum.time += by.time;
}

// `camera`: the sum of the gradients of the camera; not used without out.with_camera.
void splat_backward(const Gaussians4D& set, const View& view, const Splat& splat,
                    const SplatGradients& grad, std::size_t s, PrimitiveGradients& out,
                    CameraGrad& camera) {
  const std::size_t i = splat.id;
  const auto dt = static_cast<float>(view.t - set.time[i]);
  const Vec3 u = read3(set.velocity, i);
  const Vec3 position = position_at(read3(set.position, i), u, dt);
  const Vec3 log_scale = read3(set.log_scale, i);
  const Vec3 scale{std::exp(log_scale.x), std::exp(log_scale.y), std::exp(log_scale.z)};
  const float* r = &set.rotation[4 * i];
  const Quat rotation{r[0], r[1], r[2], r[3]};

  const Sym3 covariance = covariance_of(rotation, scale);
  const float opacity = opacity_of(set.opacity_logit[i]);
  const float sigma = set.sigma[i], radius = set.radius[i];
  const float visible = visibility(dt, sigma, radius);
  // The splat's opacity is proportional to l(t) and to O. It is rendered, so neither is 0.
  const float by_log_opacity = grad.opacity * splat.opacity;
  const SplatShapeGrad by_shape{grad.mean, grad.conic,
                                view.kernel == kBandLimited ? by_log_opacity : 0.0f,
                                splat.opacity / (opacity * visible)};
  const ProjectionGrad by_projection =
      project_gaussian_grad(view.camera, position, covariance, splat.conic, by_shape);
  const CovarianceGrad by_covariance = covariance_grad(rotation, scale, by_projection.covariance);
  const Vec3 from_camera{position.x - view.centre.x, position.y - view.centre.y,
                         position.z - view.centre.z};
  const Vec3 by_colour = colour_backward(&set.sh[i * view.stride], view, from_camera, splat.colour,
                                         grad.colour, &out.sh[s * 3 * view.coefficients]);
  const MotionGrad by_motion = position_at_grad(u, dt, vec3_add(by_projection.position, by_colour));
  const VisibilityGrad by_visibility = visibility_grad(dt, sigma, radius, by_log_opacity / visible);

  write3(out.position, s, by_motion.position);
  write3(out.velocity, s, by_motion.u);
  if (out.with_covariance) out.covariance[s] = by_projection.covariance;
  write3(out.log_scale, s,
         {by_covariance.scale.x * scale.x, by_covariance.scale.y * scale.y,
          by_covariance.scale.z * scale.z});
  out.rotation[4 * s] = by_covariance.rotation.w;
  out.rotation[4 * s + 1] = by_covariance.rotation.x;
  out.rotation[4 * s + 2] = by_covariance.rotation.y;
  out.rotation[4 * s + 3] = by_covariance.rotation.z;
  out.opacity_logit[s] = by_log_opacity / opacity * opacity_grad(opacity);
  out.time[s] = -(by_motion.dt + by_visibility.dt);
  out.sigma[s] = by_visibility.sigma;
  out.radius[s] = by_visibility.radius;
  if (!out.with_camera) return;
  CameraGrad by_camera = project_gaussian_camera_grad(
      view.camera, position, covariance, splat.conic, by_shape, by_projection, by_colour);
  by_camera.time = -out.time[s];  // l and the position depend on the difference of the times
  add_camera(by_camera, camera);
}

}  // namespace

void PrimitiveGradients::resize(std::size_t splats, int coefficients) {
  sh_coefficients = coefficients;
  for (auto* array : {&position, &log_scale, &velocity}) array->resize(3 * splats);
  rotation.resize(4 * splats);
  if (with_covariance) covariance.resize(splats);
  sh.resize(splats * 3 * static_cast<std::size_t>(coefficients));
  for (auto* array : {&opacity_logit, &time, &sigma, &radius}) array->resize(splats);
}

void project_backward(const Gaussians4D& set, float t, const PinholeCamera& camera,
                      const RasterSettings& settings, const SplatFrame& frame,
                      const std::vector<SplatGradients>& splats, PrimitiveGradients& out) {
  const View view = raster::view_of(set, t, camera, settings);
  out.resize(frame.splats.size(), view.coefficients);
  std::vector<CameraGrad> cameras((frame.splats.size() + kBlock - 1) / kBlock, CameraGrad{});
  parallel_blocks(
      std::size_t{0}, frame.splats.size(), kBlock, [&](std::size_t first, std::size_t last) {
        for (std::size_t s = first; s < last; ++s)
          splat_backward(set, view, frame.splats[s], splats[s], s, out, cameras[first / kBlock]);
      });
  out.camera = {};
  for (const CameraGrad& by : cameras) add_camera(by, out.camera);
}

void modulation_backward(const Gaussians4D& set, const SplatFrame& frame, PrimitiveGradients& out) {
  parallel_blocks(
      std::size_t{0}, frame.splats.size(), kBlock, [&](std::size_t first, std::size_t last) {
        for (std::size_t s = first; s < last; ++s) {
          const std::size_t i = frame.splats[s].id;
          write3(out.velocity, s,
                 effective_velocity_grad(set.sigma[i], set.radius[i], read3(out.velocity, s)));
        }
      });
}

}  // namespace stgs::encoder::cpu
