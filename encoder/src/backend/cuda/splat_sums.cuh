// SPDX-License-Identifier: Apache-2.0
// The inputs of the backward pass of a visible primitive: its values, its pose at the time of the
// view, and the gradients of its splat, summed over its instances.
#pragma once

#include "backend/cuda/device.cuh"
#include "math/grad.h"
#include "stgs/format/math/cuda.cuh"

namespace stgs::encoder::cuda {

using math::Quat;
using math::Sym2;
using math::Vec2;
using math::Vec3;

// The sums of a splat over its instances (sum_instances.cu).
struct Sums {
  float v[kSums];
};

__device__ inline Sums load_sums(const Workspace& w, std::uint32_t i) {
  Sums out;
#pragma unroll
  for (int q = 0; q < kSums / 4; ++q) {
    const float4 x = w.sums[std::size_t{kSums / 4} * i + q];
    out.v[4 * q] = x.x;
    out.v[4 * q + 1] = x.y;
    out.v[4 * q + 2] = x.z;
    out.v[4 * q + 3] = x.w;
  }
  return out;
}

// Gradients of a splat, from the sums over its pixels.
struct SplatGradient {
  Vec2 mean;
  Sym2 conic;
  Vec3 colour;
  float opacity;  // of the splat
  Vec2 abs_mean;
  float error;
};

__device__ inline SplatGradient splat_gradient(const Sums& s, Sym2 conic, float opacity) {
  const float gx = s.v[5], gy = s.v[6];
  SplatGradient g;
  g.colour = {s.v[0], s.v[1], s.v[2]};
  g.error = s.v[3];
  g.opacity = -s.v[4] / opacity;
  g.mean = {-(conic.xx * gx + conic.xy * gy), -(conic.xy * gx + conic.yy * gy)};
  g.conic = {0.5f * s.v[7], s.v[8], 0.5f * s.v[9]};
  g.abs_mean = {s.v[10] / kLog2E, s.v[11] / kLog2E};
  return g;
}

// `opacity`: of the splat; `opacity_t`: O_t.
__device__ inline math::SplatShapeGrad shape_gradient(const View& view, const SplatGradient& g,
                                                      float opacity, float opacity_t) {
  const float by_log_opacity = g.opacity * opacity;
  return {g.mean, g.conic, view.kernel == math::kBandLimited ? by_log_opacity : 0.0f,
          opacity / opacity_t};
}

// Returns the gradient of a colour before it is clamped at 0.
__device__ inline Vec3 unclamped(const ScreenSplat& splat, Vec3 grad) {
  return {splat.colour.x > 0.0f ? grad.x : 0.0f, splat.colour.y > 0.0f ? grad.y : 0.0f,
          splat.colour.z > 0.0f ? grad.z : 0.0f};
}

// Returns the gradient of the position at t through the colour, from that of the colour.
__device__ inline Vec3 by_direction(const float* sh, int coefficients, Vec3 direction,
                                    float inverse_length, Vec3 grad) {
  if (coefficients == 1) return {0.0f, 0.0f, 0.0f};
  math::ShBasis by_basis{};
#pragma unroll
  for (int k = 0; k < math::kShMaxCoefficients; ++k) {
    if (k >= coefficients) break;
    by_basis.v[k] = sh[3 * k] * grad.x + sh[3 * k + 1] * grad.y + sh[3 * k + 2] * grad.z;
  }
  return math::normalise_grad(direction, inverse_length, math::sh_basis_grad(direction, by_basis));
}

// The values of a primitive, loaded early to hide latency.
struct PrimitiveValues {
  Vec3 position, log_scale, u;
  float4 rotation;
  float time, logit, sigma, radius;
};

__device__ inline PrimitiveValues load_values(const Primitives& p, std::uint32_t i) {
  PrimitiveValues own;
  own.position = read3(p.rendered.position, i);
  own.log_scale = read3(p.rendered.log_scale, i);
  own.u = read3(p.rendered.u, i);
  own.rotation = reinterpret_cast<const float4*>(p.rendered.rotation)[i];
  own.time = p.values[kTime][i];
  own.logit = p.rendered.opacity[i];
  own.sigma = p.sigma[i];
  own.radius = p.values[kRadius][i];
  return own;
}

// A primitive at the time of the view.
struct Pose {
  float dt;
  Vec3 position, scale;
  Quat rotation;
};

__device__ inline Pose pose_of(const PrimitiveValues& own, const View& view) {
  const float dt = view.ticks - own.time;
  return {dt,
          math::position_at(own.position, own.u, dt),
          {expf(own.log_scale.x), expf(own.log_scale.y), expf(own.log_scale.z)},
          {own.rotation.x, own.rotation.y, own.rotation.z, own.rotation.w}};
}

}  // namespace stgs::encoder::cuda
