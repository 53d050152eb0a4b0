// SPDX-License-Identifier: Apache-2.0
// Device functions that the CUDA kernels of encoder and player share: sums over a warp, the fast
// power of 2, and loading of splats.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>

#include "stgs/format/math/screen_splat.h"

namespace stgs::math {

inline constexpr unsigned kAllLanes = 0xFFFFFFFFu;

// Returns the sum of `x` over the lanes of the warp to each of them. The whole warp calls it.
template <typename T>
__device__ inline T warp_sum(T x) {
  for (int step = 16; step > 0; step >>= 1) x += __shfl_xor_sync(kAllLanes, x, step);
  return x;
}

// Returns 2^x within 2 ulp, or 0 if it is subnormal.
__device__ inline float exp2_fast(float x) {
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}

// A ScreenSplat as vectors: mean, falloff.xx and .xy; falloff.yy, peak, extent; colour, depth.
struct SplatVectors {
  float4 a, b, c;
};

__device__ inline SplatVectors load_vectors(const ScreenSplat* splats, std::uint32_t i) {
  const float4* const at = reinterpret_cast<const float4*>(splats + i);
  return {__ldg(at), __ldg(at + 1), __ldg(at + 2)};
}

__device__ inline ScreenSplat load_splat(const ScreenSplat* splats, std::uint32_t i) {
  const SplatVectors v = load_vectors(splats, i);
  return {{v.a.x, v.a.y}, {v.a.z, v.a.w, v.b.x}, v.b.y,
          {v.b.z, v.b.w}, {v.c.x, v.c.y, v.c.z}, v.c.w};
}

}  // namespace stgs::math
