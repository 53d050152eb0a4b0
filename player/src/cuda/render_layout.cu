// SPDX-License-Identifier: Apache-2.0
#include "cuda/render_layout.h"

#include <cuda_fp16.h>

#include "cuda/launch.cuh"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"

namespace stgs::player::cuda {
namespace {

using namespace math;

__device__ unsigned half_bits(float x) {
  constexpr float kMaxHalf = 65504.0f;
  // Values that are not finite stay so: such primitives are not rendered.
  const float clamped_x = isfinite(x) ? clamped(x, -kMaxHalf, kMaxHalf) : x;
  return __half_as_ushort(__float2half_rn(clamped_x));
}

__global__ void __launch_bounds__(kChunk) pack(const DeviceGaussians from, PrimitiveRange range,
                                               int floats, int planes, PackedSegment to) {
  const std::uint32_t i = blockIdx.x * kChunk + threadIdx.x, at = range.first + i;
  const std::uint32_t stride = padded(range.of);
  if (i >= range.count) {
    to.support[at] = make_float2(kNever, -kNever);
    return;
  }
  const float opacity = opacity_of(from.opacity_logit[i]), time = from.time[i];
  const float sigma = from.sigma[i], radius = from.radius[i];
  const Support support = candidate_support(opacity, time, sigma, radius, kAlphaThreshold);
  to.support[at] = make_float2(support.begin, support.end);
  const float *x = from.position + 3 * i, *u = from.velocity + 3 * i, *s = from.log_scale + 3 * i;
  const float* q = from.rotation + std::size_t{4} * i;
  to.position_time[at] = make_float4(x[0], x[1], x[2], time);
  to.velocity_opacity[at] = make_float4(u[0], u[1], u[2], opacity);
  to.lifespan[at] = make_float2(sigma, radius);
  const Sym3 v =
      covariance_of({q[0], q[1], q[2], q[3]}, {std::exp(s[0]), std::exp(s[1]), std::exp(s[2])});
  to.covariance[at] = make_float4(v.xx, v.xy, v.xz, v.yy);
  to.covariance_rest[at] = make_float2(v.yz, v.zz);
  const float* sh = from.sh + std::size_t{1} * floats * i;
  for (int p = 0; p < planes; ++p) {
    unsigned bits[4];
    for (int k = 0; k < 4; ++k) bits[k] = 4 * p + k < floats ? half_bits(sh[4 * p + k]) : 0;
    to.sh[std::size_t{1} * stride * p + at] =
        make_uint2(bits[0] | bits[1] << 16, bits[2] | bits[3] << 16);
  }
}

}  // namespace

void pack_segment(const DeviceGaussians& from, const PrimitiveRange& range, int sh_degree,
                  const PackedSegment& to, cudaStream_t stream) {
  if (range.count == 0) return;
  const int floats = 3 * (sh_degree + 1) * (sh_degree + 1);
  launch(pack, padded(range.count) / kChunk, kChunk, stream, from, range, floats,
         sh_planes(sh_degree), to);
}

}  // namespace stgs::player::cuda
