// SPDX-License-Identifier: Apache-2.0
// Device functions shared by several kernels: alpha, ellipse test, block sums, Adam.
#pragma once

#include "backend/cuda/kernels.h"
#include "stgs/format/math/cuda.cuh"
#include "train/adam.h"
#include "train/colour_inverse.h"

namespace stgs::encoder::cuda {

using math::exp2_fast;
using math::kAllLanes;
using math::kLog2E;
using math::kLog2Threshold;
using math::load_splat;
using math::warp_sum;

__device__ inline math::Vec3 read3(const float* array, std::uint32_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

// Returns the background of the rendered colours, before the colour map.
__device__ inline math::Vec3 rendered_background(const Background& background) {
  return background.map == nullptr ? background.colour
                                   : before_colour_map(background.map, background.colour);
}

// Returns the part of a rendered colour on which the colour map acts, and in w the weight of the
// map's offset. `rendered`: with the transmittance in w.
__device__ inline float4 mapped_part(const Background& background, float4 rendered) {
  if (background.map == nullptr) return make_float4(rendered.x, rendered.y, rendered.z, 1.0f);
  const math::Vec3 b = rendered_background(background);
  const float t = rendered.w;
  return make_float4(rendered.x - t * b.x, rendered.y - t * b.y, rendered.z - t * b.z, 1.0f - t);
}

// Returns log2 of the splat's alpha at an offset from its mean, before clamping at kAlphaMax.
__device__ inline float log2_alpha(const ScreenSplat& s, float dx, float dy) {
  const float along = fmaf(s.falloff.xx, dx, s.falloff.xy * dy);
  return fminf(s.peak, fmaf(dx, along, fmaf(s.falloff.yy * dy, dy, s.peak)));
}

// Returns 1 / x within 1 ulp, for x that is neither tiny nor huge.
__device__ inline float reciprocal_fast(float x) {
  float y;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

// Returns the minimum of -log2(falloff) on the line segment with one offset `fixed` and the other
// in [low, high], minus the rounding error that the blend may make there (raster/bin.cpp).
__device__ inline float edge_minimum(float across, float cross, float along, float fixed, float low,
                                     float high) {
  const float best = __fdividef(-0.5f * cross * fixed, along);
  const float free = fminf(fmaxf(best, low), high);
  const float a = across * fixed * fixed, b = along * free * free, c = cross * fixed * free;
  return a + b + c - 1e-6f * (a + b + fabsf(c));
}

// Returns whether the splat's ellipse intersects the rectangle [x0,x1] x [y0,y1] of pixel centres.
__device__ inline bool ellipse_meets(const ScreenSplat& s, float x0, float x1, float y0, float y1) {
  x0 -= s.mean.x;
  x1 -= s.mean.x;
  y0 -= s.mean.y;
  y1 -= s.mean.y;
  const bool in_x = x0 <= 0.0f && x1 >= 0.0f, in_y = y0 <= 0.0f && y1 >= 0.0f;
  if (in_x && in_y) return true;
  const float limit = s.peak - kLog2Threshold + 0.5e-4f * kLog2E;
  const float xx = -s.falloff.xx, xy = -s.falloff.xy, yy = -s.falloff.yy;
  // A convex form has its minimum on an edge that faces its centre.
  if (!in_x && edge_minimum(xx, xy, yy, x0 > 0.0f ? x0 : x1, y0, y1) <= limit) return true;
  return !in_y && edge_minimum(yy, xy, xx, y0 > 0.0f ? y0 : y1, x0, x1) <= limit;
}

// Returns the sum over a block of kThreads; valid in thread 0.
template <int kThreads>
__device__ inline float block_sum(float x) {
  __shared__ float sums[kThreads / 32];
  x = warp_sum(x);
  __syncthreads();
  if ((threadIdx.x & 31) == 0) sums[threadIdx.x / 32] = x;
  __syncthreads();
  float sum = 0.0f;
  for (float s : sums) sum += s;
  return sum;
}

__device__ inline float sqrt_fast(float x) {
  float y;
  asm("sqrt.approx.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

// Bias correction of Adam (AdamCorrection of train/adam.h).
struct AdamFactors {
  float first, second_root;
};

__device__ inline AdamFactors adam_factors(std::uint32_t updates, AdamBetas betas = AdamBetas()) {
  const float n = static_cast<float>(updates);
  return {1.0f / (1.0f - powf(betas.first, n)), 1.0f / sqrtf(1.0f - powf(betas.second, n))};
}

// Returns the value after one Adam step (adam_step of train/adam.h); updates the moments.
__device__ inline float adam(float value, float& first, float& second, float gradient, float rate,
                             AdamFactors factors, AdamBetas betas = AdamBetas()) {
  first = betas.first * first + (1.0f - betas.first) * gradient;
  second = betas.second * second + (1.0f - betas.second) * gradient * gradient;
  const float scale = sqrt_fast(second) * factors.second_root + kAdamEpsilon;
  return value - rate * __fdividef(first * factors.first, scale);
}

}  // namespace stgs::encoder::cuda
