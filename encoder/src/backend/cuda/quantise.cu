// SPDX-License-Identifier: Apache-2.0
// Rounds the learnt values to those that a decoder reconstructs: round_primitive() of
// train/rounding.cpp.
#include "backend/cuda/update_rows.cuh"
#include "stgs/format/math/quant.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kBlock = 256;

__device__ void write_at(float* array, std::size_t i, Vec3 v) {
  write3(array + 3 * i, v);
}

// Copies the values of a fixed primitive, which is not rounded.
__device__ void copy_shape(const Primitives& p, const RoundedValues& out, std::uint32_t i) {
  write_at(out.position, i, read3(p.values[kPosition], i));
  write_at(out.log_scale, i, read3(p.values[kLogScale], i));
  reinterpret_cast<float4*>(out.rotation)[i] =
      reinterpret_cast<const float4*>(p.values[kRotation])[i];
  out.opacity[i] = p.values[kOpacity][i];
  write_at(out.u, i, read3(p.u, i));
}

__global__ void __launch_bounds__(kBlock)
    round_shapes(const Primitives p, const RoundedValues out) {
  const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
  if (i >= p.n) return;
  if (p.updates[i] == kFixed) {
    copy_shape(p, out, i);
    return;
  }
  const RoundingSteps& steps = p.rules->tiers[p.tier[i]];
  const Vec3 log_scale = rounded3(read3(p.values[kLogScale], i), steps.log_scale);
  write_at(out.position, i, rounded3(read3(p.values[kPosition], i), steps.position));
  write_at(out.log_scale, i, log_scale);
  const float4 q = reinterpret_cast<const float4*>(p.values[kRotation])[i];
  const Quat turned = rounded_rotation({q.x, q.y, q.z, q.w}, steps.rotation, log_scale);
  reinterpret_cast<float4*>(out.rotation)[i] = make_float4(turned.w, turned.x, turned.y, turned.z);
  out.opacity[i] = rounded_to(p.values[kOpacity][i], p.rules->opacity);
  const float scale = displacement_scale(p.sigma[i], p.values[kRadius][i], p.rules->part_ticks);
  write_at(out.u, i, rounded3(read3(p.u, i), steps.displacement * scale));
}

// One thread per coefficient.
__global__ void __launch_bounds__(kBlock)
    round_colours(const Primitives p, const RoundedValues out) {
  const std::uint32_t k = blockIdx.x * kBlock + threadIdx.x;
  if (k >= p.n * p.sh_coefficients) return;
  const std::uint32_t i = k / p.sh_coefficients;
  const int c = static_cast<int>(k % p.sh_coefficients);
  const Vec3 learnt = read3(p.values[kSh], k);
  const float step = p.rules->tiers[p.tier[i]].sh[sh_band_of(c)];
  write_at(out.sh, k,
           p.updates[i] == kFixed
               ? learnt
               : rounded_colour(learnt, step, c == 0 ? 0.5f : kRoundingDeadZone));
}

}  // namespace

void launch_rounding(const Primitives& p, const RoundedValues& out, cudaStream_t stream) {
  round_shapes<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, out);
  round_colours<<<blocks_of(std::size_t{p.n} * p.sh_coefficients, kBlock), kBlock, 0, stream>>>(
      p, out);
}

}  // namespace stgs::encoder::cuda
