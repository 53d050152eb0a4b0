// SPDX-License-Identifier: Apache-2.0
// Slices the set at t, one thread per primitive: make_splat() of format/src/raster/slice.cpp.
#include "backend/cuda/device.cuh"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/math/surface.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kBlock = 256;

__device__ Vec3 read3(const float* array, std::uint32_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

// Returns false if the distance or an SH sum is not finite.
__device__ bool colour_of(const float* sh, int coefficients, Vec3 from_camera, Vec3& colour) {
  const float square = dot3(from_camera, from_camera);
  const float n = 1.0f / sqrtf(square);
  const ShBasis basis = sh_basis({from_camera.x * n, from_camera.y * n, from_camera.z * n});
  Vec3 sum{0, 0, 0};
#pragma unroll
  for (int k = 0; k < kShMaxCoefficients; ++k) {
    if (k >= coefficients) break;
    sum.x += basis.v[k] * sh[3 * k];
    sum.y += basis.v[k] * sh[3 * k + 1];
    sum.z += basis.v[k] * sh[3 * k + 2];
  }
  colour = {sh_colour(sum.x), sh_colour(sum.y), sh_colour(sum.z)};
  return isfinite(square) && isfinite(sum.x) && isfinite(sum.y) && isfinite(sum.z);
}

__device__ bool make_splat(const Primitives& p, std::uint32_t i, const View& view,
                           ScreenSplat& out) {
  if (view.drop_share > 0.0f && dropped(view.drop_random, view.drop_share, i)) return false;
  const float dt = view.ticks - p.values[kTime][i];
  const float sigma = p.sigma[i], radius = p.values[kRadius][i];
  const float beyond = fabsf(dt) - radius;
  if (beyond > 0.0f && beyond * beyond > kReachMax * sigma * sigma) return false;
  const Vec3 position = position_at(read3(p.rendered.position, i), read3(p.rendered.u, i), dt);
  if (!(to_camera(view.camera, position).z >= view.camera.near_plane)) return false;
  const float opacity_t = opacity_of(p.rendered.opacity[i]) * visibility(dt, sigma, radius);
  if (!(opacity_t >= kAlphaThreshold)) return false;

  const Vec3 log_scale = read3(p.rendered.log_scale, i);
  const float4 r = reinterpret_cast<const float4*>(p.rendered.rotation)[i];
  const Sym3 covariance = covariance_of({r.x, r.y, r.z, r.w},
                                        {expf(log_scale.x), expf(log_scale.y), expf(log_scale.z)});
  const Projection q =
      project_gaussian(view.camera, position, covariance, screen_blur(view.kernel));
  const float opacity = splat_opacity(view.kernel, opacity_t, q);
  const SplatBox box = splat_box(view.camera, q, opacity);
  if (!box.visible) return false;
  const Vec3 from_camera{position.x - view.centre.x, position.y - view.centre.y,
                         position.z - view.centre.z};
  Vec3 colour;
  if (!colour_of(p.rendered.sh + std::size_t{3} * p.sh_coefficients * i, view.coefficients,
                 from_camera, colour))
    return false;
  out = screen_splat(q, box.extent, opacity, colour);
  return true;
}

__device__ float4 plane_of(const Primitives& p, std::uint32_t i, const View& view) {
  const Vec3 position = position_at(read3(p.rendered.position, i), read3(p.rendered.u, i),
                                    view.ticks - p.values[kTime][i]);
  const float4 r = reinterpret_cast<const float4*>(p.rendered.rotation)[i];
  const Plane plane =
      primitive_plane(view.camera, position, {r.x, r.y, r.z, r.w}, read3(p.rendered.log_scale, i));
  return make_float4(plane.normal.x, plane.normal.y, plane.normal.z, plane.distance);
}

template <bool kPlanes>
__global__ void __launch_bounds__(kBlock)
    slice(const Primitives p, const View view, ScreenSplat* splats, float4* planes,
          std::uint32_t* depth_keys, Counters* counters) {
  const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
  ScreenSplat splat;
  const bool visible = i < p.n && make_splat(p, i, view, splat);
  if (i < p.n) depth_keys[i] = visible ? __float_as_uint(splat.depth) : kInvisible;
  if (visible) splats[i] = splat;
  if (kPlanes && visible) planes[i] = plane_of(p, i, view);
  const int count = __syncthreads_count(visible);
  if (threadIdx.x == 0 && count > 0) atomicAdd(&counters->visible, count);
}

}  // namespace

void launch_slice(const Primitives& p, const View& view, const Workspace& w, cudaStream_t stream) {
  const auto kernel = view.planes ? slice<true> : slice<false>;
  kernel<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, view, w.splats, w.planes, w.depth_keys,
                                                        w.counters);
}

}  // namespace stgs::encoder::cuda
