// SPDX-License-Identifier: Apache-2.0
// Slice at t: one candidate a thread, cheapest tests first, as raster_slice.cpp's make_splat. What
// does not depend on the view is done once. A block takes a chunk of candidates; its splats follow
// those of the chunks before, so that their order is that of the ids, whichever block is first.
#include <cuda_fp16.h>

#include "cuda/frame_input.cuh"
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

// A candidate at the moment.
struct Alive {
  PackedSegment at;
  std::uint32_t i, stride;  // of the harmonics' planes
  Vec3 position;
  float opacity;
};

// False where it is not drawn from anywhere.
__device__ bool find_alive(const Part& part, std::uint32_t i, Alive& out) {
  out.at = packed_at(part.memory, part.primitives);
  out.i = i;
  out.stride = padded(part.primitives);
  const float4 place = __ldg(out.at.place + i);
  const float4 motion = __ldg(out.at.motion + i);
  const float2 lifespan = __ldg(out.at.lifespan + i);
  const float dt = static_cast<float>(part.ticks - static_cast<double>(place.w));
  out.position = position_at({place.x, place.y, place.z}, {motion.x, motion.y, motion.z}, dt);
  out.opacity = motion.w * visibility(dt, lifespan.x, lifespan.y);
  return out.opacity >= kAlphaThreshold;
}

// Its splat in a view; false where it is not visible.
template <int kDegree>
__device__ bool make_splat(const Alive& alive, const ViewInput& view, ScreenSplat& out) {
  const Vec3 position = alive.position;
  const float opacity = alive.opacity;
  if (!(to_camera(view.camera, position).z >= view.camera.near_plane)) return false;
  const float4 c = __ldg(alive.at.covariance + alive.i);
  const float2 rest = __ldg(alive.at.covariance_rest + alive.i);
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
         colour_of<kDegree>(alive.at.sh + alive.i, alive.stride, from_camera, out);
}

__device__ void store_splat(const ScreenSplat& s, ScreenSplat* to) {
  float4* const four = reinterpret_cast<float4*>(to);
  four[0] = make_float4(s.x, s.y, s.half_xx, s.cross);
  four[1] = make_float4(s.half_yy, s.most, s.extent_x, s.extent_y);
  four[2] = make_float4(s.red, s.green, s.blue, s.depth);
}

// A thread block takes a chunk of candidates. A thread has the splats of one, of all views.
template <int kDegree, bool kSeveral>
__global__ void __launch_bounds__(kChunk, 3) project(const FrameInput* input, const Workspace w) {
  __shared__ FrameInput frame;
  __shared__ std::uint32_t digits[kDepthPasses][kDigits];
  __shared__ std::uint32_t sums[kWarps];
  __shared__ std::uint32_t chunk, before;
  load_frame(input, frame);
  for (int p = 0; p < kDepthPasses; ++p) digits[p][threadIdx.x] = 0;
  const std::uint32_t alive_count = w.counters->alive;
  for (;;) {
    if (threadIdx.x == 0) chunk = atomicAdd(&w.counters->project_ticket, 1u);
    __syncthreads();
    if (chunk * kChunk >= alive_count) break;
    const std::uint32_t rank = chunk * kChunk + threadIdx.x;
    ScreenSplat splats[kSeveral ? kMostViews : 1];
    const std::uint32_t views = kSeveral ? frame.view_count : 1;
    unsigned seen = 0;  // a bit a view
    if (rank < alive_count) {
      const Candidate candidate = w.candidates[rank];
      Alive alive;
      if (find_alive(parts_of(input)[candidate.part], candidate.primitive, alive)) {
#pragma unroll 1
        for (std::uint32_t v = 0; v < views; ++v) {
          if (make_splat<kDegree>(alive, frame.views[v], splats[v])) seen |= 1u << v;
        }
      }
    }

    std::uint32_t total;
    const std::uint32_t place = block_sum_before<kWarps>(__popc(seen), sums, total);
    if (threadIdx.x < 32) {
      const Told found = sum_before(w.project_told, chunk, total);
      if (threadIdx.x == 0) {
        before = static_cast<std::uint32_t>(found);
        if ((chunk + 1) * kChunk >= alive_count) {
          const std::uint32_t all = before + total;
          w.counters->visible = all;
          w.counters->splats = all <= w.splat_capacity ? all : 0;
        }
      }
    }
    __syncthreads();
    if (before + total <= w.splat_capacity) {
      std::uint32_t to = before + place;
#pragma unroll 1
      for (std::uint32_t v = 0; v < views; ++v) {
        if ((seen >> v & 1u) == 0) continue;
        const std::uint32_t key = __float_as_uint(splats[v].depth);
        store_splat(splats[v], w.splats + to);
        w.depth_keys[0][to] = key;
        w.depth_order[0][to] = to | v << kSplatBits;
        for (int p = 0; p < kDepthPasses; ++p) atomicAdd(&digits[p][key >> 8 * p & 0xFFu], 1u);
        ++to;
      }
    }
    __syncthreads();
  }
  for (int p = 0; p < kDepthPasses; ++p) {
    const std::uint32_t n = digits[p][threadIdx.x];
    if (n != 0) atomicAdd(w.depth_digits + p * kDigits + threadIdx.x, n);
  }
}

using Kernel = void (*)(const FrameInput*, Workspace);

template <bool kSeveral>
Kernel kernel_of(int sh_degree) {
  switch (sh_degree) {
    case 0:
      return project<0, kSeveral>;
    case 1:
      return project<1, kSeveral>;
    case 2:
      return project<2, kSeveral>;
    default:
      return project<3, kSeveral>;
  }
}

}  // namespace

cudaError_t project_grids(int sh_degree, unsigned& one, unsigned& several) {
  const cudaError_t error = resident_blocks(kernel_of<false>(sh_degree), kChunk, one);
  return error != cudaSuccess ? error
                              : resident_blocks(kernel_of<true>(sh_degree), kChunk, several);
}

void launch_project(int sh_degree, bool several, const FrameInput* input, const Workspace& w,
                    const Grids& grids, cudaStream_t stream) {
  if (several) {
    launch(kernel_of<true>(sh_degree), grids.project_several, kChunk, stream, input, w);
  } else {
    launch(kernel_of<false>(sh_degree), grids.project_one, kChunk, stream, input, w);
  }
}

}  // namespace stgs::player::cuda
