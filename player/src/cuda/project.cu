// SPDX-License-Identifier: Apache-2.0
// Slice at t: one primitive a thread, cheapest tests first, as raster_slice.cpp's make_splat. A
// block takes a chunk of a part; its splats follow those of the chunks before, so that their order
// is that of the ids, whichever block is first.
#include <cuda_fp16.h>

#include "cuda/draw.h"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/sh.h"

namespace stgs::player::cuda {
namespace {

using namespace math;

constexpr int kWarps = kChunk / 32;
constexpr float kLog2E = 1.44269504f;

__device__ float half_of(std::uint32_t bits) {
  return __half2float(__ushort_as_half(static_cast<unsigned short>(bits)));
}

// False where the distance or a sum of the harmonics is not finite (representation 4.6).
template <int kDegree>
__device__ bool colour_of(const uint2* sh, std::uint32_t stride, Vec3 from_camera,
                          ScreenSplat& out) {
  const float square = dot3(from_camera, from_camera);
  const float n = 1.0f / sqrtf(square);
  const ShBasis basis = sh_basis({from_camera.x * n, from_camera.y * n, from_camera.z * n});
  constexpr int kFloats = 3 * (kDegree + 1) * (kDegree + 1);
  float sums[3] = {0.0f, 0.0f, 0.0f};
#pragma unroll
  for (int p = 0; p < sh_planes(kDegree); ++p) {
    const uint2 four = __ldg(sh + std::size_t{1} * stride * p);
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      const int number = 4 * p + k;
      if (number >= kFloats) break;
      const std::uint32_t pair = k < 2 ? four.x : four.y;
      sums[number % 3] += basis.v[number / 3] * half_of(k % 2 == 0 ? pair & 0xFFFFu : pair >> 16);
    }
  }
  out.red = sh_colour(sums[0]);
  out.green = sh_colour(sums[1]);
  out.blue = sh_colour(sums[2]);
  return isfinite(square) && isfinite(sums[0]) && isfinite(sums[1]) && isfinite(sums[2]);
}

// The splat of primitive i of a part at which it is alive; false where it is not visible.
template <int kDegree>
__device__ bool make_splat(const Part& part, std::uint32_t i, const ViewInput& view,
                           ScreenSplat& out) {
  const float4 place = __ldg(part.at.place + i);
  const float4 motion = __ldg(part.at.motion + i);
  const float2 lifespan = __ldg(part.at.lifespan + i);
  const float dt = static_cast<float>(part.ticks - static_cast<double>(place.w));
  const Vec3 position =
      position_at({place.x, place.y, place.z}, {motion.x, motion.y, motion.z}, dt);
  if (!(to_camera(view.camera, position).z >= view.camera.near_plane)) return false;
  const float opacity = motion.w * visibility(dt, lifespan.x, lifespan.y);
  if (!(opacity >= kAlphaThreshold)) return false;

  const float4 c = __ldg(part.at.covariance + i);
  const float2 rest = __ldg(part.at.covariance_rest + i);
  const Projection p =
      project_gaussian(view.camera, position, {c.x, c.y, c.z, c.w, rest.x, rest.y});
  if (!p.visible) return false;
  const float elongation = elongation_of(p);
  if (!isfinite(elongation) || !isfinite(p.conic.xy)) return false;
  const Vec2 extent = splat_extent(p.covariance, opacity, kAlphaThreshold);
  const float slack = extent_slack(elongation);
  out.extent_x = extent.x * slack;
  out.extent_y = extent.y * slack;
  if (outside_image(view.camera, p.mean, {out.extent_x, out.extent_y})) return false;

  out.x = p.mean.x;
  out.y = p.mean.y;
  out.half_xx = -0.5f * kLog2E * p.conic.xx;
  out.cross = -kLog2E * p.conic.xy;
  out.half_yy = -0.5f * kLog2E * p.conic.yy;
  out.most = log2f(opacity);
  out.depth = p.depth;
  const Vec3 from_camera{position.x - view.centre.x, position.y - view.centre.y,
                         position.z - view.centre.z};
  return isfinite(p.depth) &&
         colour_of<kDegree>(part.at.sh + i, padded(part.primitives), from_camera, out);
}

__device__ void store_splat(const ScreenSplat& s, ScreenSplat* to) {
  float4* const four = reinterpret_cast<float4*>(to);
  four[0] = make_float4(s.x, s.y, s.half_xx, s.cross);
  four[1] = make_float4(s.half_yy, s.most, s.extent_x, s.extent_y);
  four[2] = make_float4(s.red, s.green, s.blue, s.depth);
}

// The part that has the chunk: the last one that begins at or before it.
__device__ std::uint32_t part_of(const Part* parts, std::uint32_t count, std::uint32_t chunk) {
  std::uint32_t low = 0, high = count;
  while (high - low > 1) {
    const std::uint32_t middle = (low + high) / 2;
    if (parts[middle].first_chunk <= chunk) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

template <int kDegree>
__global__ void __launch_bounds__(kChunk, 3) project(const ViewInput* input, const Workspace w) {
  __shared__ ViewInput view;
  __shared__ Part part;
  __shared__ std::uint32_t digits[kDepthPasses][kDigits];
  __shared__ std::uint32_t sums[kWarps];
  __shared__ std::uint32_t chunk, before;
  const Part* const parts = reinterpret_cast<const Part*>(input + 1);
  if (threadIdx.x == 0) view = *input;
  for (int p = 0; p < kDepthPasses; ++p) digits[p][threadIdx.x] = 0;
  std::uint32_t alive_here = 0;
  for (;;) {
    if (threadIdx.x == 0) {
      chunk = atomicAdd(&w.counters->project_ticket, 1u);
      if (chunk < view.chunks) part = parts[part_of(parts, view.parts, chunk)];
    }
    __syncthreads();
    if (chunk >= view.chunks) break;
    const std::uint32_t i = (chunk - part.first_chunk) * kChunk + threadIdx.x;
    const float2 support = __ldg(part.at.support + i);
    const auto ticks = static_cast<float>(part.ticks);
    const bool alive = support.x <= ticks && ticks <= support.y;
    alive_here += alive;
    ScreenSplat splat;
    const bool visible = alive && make_splat<kDegree>(part, i, view, splat);

    std::uint32_t total;
    const std::uint32_t place = block_sum_before<kWarps>(visible, sums, total);
    if (threadIdx.x < 32) {
      const Told found = sum_before(w.project_told, chunk, total);
      if (threadIdx.x == 0) {
        before = static_cast<std::uint32_t>(found);
        if (chunk + 1 == view.chunks) w.counters->visible = before + total;
      }
    }
    __syncthreads();
    if (visible) {
      const std::uint32_t key = __float_as_uint(splat.depth);
      store_splat(splat, w.splats + before + place);
      w.depth_keys[0][before + place] = key;
      for (int p = 0; p < kDepthPasses; ++p) atomicAdd(&digits[p][key >> 8 * p & 0xFFu], 1u);
    }
    __syncthreads();
  }
  for (int p = 0; p < kDepthPasses; ++p) {
    const std::uint32_t n = digits[p][threadIdx.x];
    if (n != 0) atomicAdd(w.depth_digits + p * kDigits + threadIdx.x, n);
  }
  alive_here = warp_sum(alive_here);
  if ((threadIdx.x & 31) == 0 && alive_here != 0) atomicAdd(&w.counters->alive, alive_here);
}

using Kernel = void (*)(const ViewInput*, Workspace);

Kernel kernel_of(int sh_degree) {
  switch (sh_degree) {
    case 0:
      return project<0>;
    case 1:
      return project<1>;
    case 2:
      return project<2>;
    default:
      return project<3>;
  }
}

}  // namespace

cudaError_t project_grid(int sh_degree, unsigned& blocks) {
  return resident_blocks(kernel_of(sh_degree), kChunk, blocks);
}

void launch_project(int sh_degree, const ViewInput* input, const Workspace& w, const Grids& grids,
                    cudaStream_t stream) {
  launch(kernel_of(sh_degree), grids.project, kChunk, stream, input, w);
}

}  // namespace stgs::player::cuda
