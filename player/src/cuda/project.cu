// SPDX-License-Identifier: Apache-2.0
// Slices the candidates at a time: one candidate per thread, cheapest tests first, as make_splat()
// in raster/slice.cpp. View-independent work is done once. A thread block takes a chunk of
// candidates. Its splats follow those of the chunks before, so that splats are in id order
// regardless of scheduling.
#include <cuda_fp16.h>

#include "cuda/frame_input.cuh"
#include "cuda/grid.cuh"
#include "cuda/launch.cuh"
#include "cuda/look_back.cuh"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/screen_splat.h"
#include "stgs/format/math/sh.h"

namespace stgs::player::cuda {
namespace {

using namespace math;

constexpr int kWarps = kChunk / 32;

__device__ float half_of(std::uint32_t bits) {
  return __half2float(__ushort_as_half(static_cast<unsigned short>(bits)));
}

// Returns false if the distance or a sum of the SH coefficients is not finite (representation 4.6).
template <int kDegree>
__device__ bool colour_of(const uint2* sh, std::uint32_t stride, Vec3 from_camera, Vec3& colour) {
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
  colour = {sh_colour(sums[0]), sh_colour(sums[1]), sh_colour(sums[2])};
  return isfinite(square) && isfinite(sums[0]) && isfinite(sums[1]) && isfinite(sums[2]);
}

// A candidate at the rendered time.
struct Active {
  PackedSegment at;
  std::uint32_t i, stride;  // stride: of the SH planes
  Vec3 position;
  float opacity;
};

// Returns false if the candidate is invisible from everywhere.
__device__ bool find_active(const Part& part, std::uint32_t i, Active& out) {
  out.at = packed_at(part.memory, part.primitives);
  out.i = i;
  out.stride = padded(part.primitives);
  const float4 position_time = __ldg(out.at.position_time + i);
  const float4 velocity_opacity = __ldg(out.at.velocity_opacity + i);
  const float2 lifespan = __ldg(out.at.lifespan + i);
  const float dt = static_cast<float>(part.ticks - static_cast<double>(position_time.w));
  out.position = position_at({position_time.x, position_time.y, position_time.z},
                             {velocity_opacity.x, velocity_opacity.y, velocity_opacity.z}, dt);
  out.opacity = velocity_opacity.w * visibility(dt, lifespan.x, lifespan.y);
  return out.opacity >= kAlphaThreshold;
}

// Computes the splat of a candidate in a view. Returns false if it is not visible.
template <int kDegree>
__device__ bool make_splat(const Active& active, const ViewInput& view, ScreenSplat& out) {
  const Vec3 position = active.position;
  if (!(to_camera(view.camera, position).z >= view.camera.near_plane)) return false;
  const float4 c = __ldg(active.at.covariance + active.i);
  const float2 rest = __ldg(active.at.covariance_rest + active.i);
  const Projection p = project_gaussian(view.camera, position, {c.x, c.y, c.z, c.w, rest.x, rest.y},
                                        screen_blur(view.kernel));
  const float opacity = splat_opacity(view.kernel, active.opacity, p);
  const SplatBox box = splat_box(view.camera, p, opacity);
  if (!box.visible) return false;
  const Vec3 from_camera{position.x - view.centre.x, position.y - view.centre.y,
                         position.z - view.centre.z};
  Vec3 colour;
  if (!colour_of<kDegree>(active.at.sh + active.i, active.stride, from_camera, colour))
    return false;
  out = screen_splat(p, box.extent, opacity, colour);
  return true;
}

__device__ void store_splat(const ScreenSplat& s, ScreenSplat* to) {
  float4* const four = reinterpret_cast<float4*>(to);
  four[0] = make_float4(s.mean.x, s.mean.y, s.falloff.xx, s.falloff.xy);
  four[1] = make_float4(s.falloff.yy, s.peak, s.extent.x, s.extent.y);
  four[2] = make_float4(s.colour.x, s.colour.y, s.colour.z, s.depth);
}

// A thread computes the splats of one candidate in all views.
template <int kDegree, bool kSeveral>
__global__ void __launch_bounds__(kChunk, 3) project(const FrameInput* input, const Workspace w) {
  __shared__ FrameInput frame;
  __shared__ std::uint32_t digits[kDepthPasses][kDigits];
  __shared__ std::uint32_t sums[kWarps];
  __shared__ std::uint32_t chunk, before;
  load_frame(input, frame);
  for (int p = 0; p < kDepthPasses; ++p) digits[p][threadIdx.x] = 0;
  const std::uint32_t active_count = w.counters->active;
  for (;;) {
    if (threadIdx.x == 0) chunk = atomicAdd(&w.counters->project_ticket, 1u);
    __syncthreads();
    if (chunk * kChunk >= active_count) break;
    const std::uint32_t rank = chunk * kChunk + threadIdx.x;
    ScreenSplat splats[kSeveral ? kMaxFrameViews : 1];
    const std::uint32_t views = kSeveral ? frame.view_count : 1;
    unsigned visible = 0;  // one bit per view
    if (rank < active_count) {
      const Candidate candidate = w.candidates[rank];
      Active active;
      if (find_active(parts_of(input)[candidate.part], candidate.primitive, active)) {
#pragma unroll 1
        for (std::uint32_t v = 0; v < views; ++v) {
          if (make_splat<kDegree>(active, frame.views[v], splats[v])) visible |= 1u << v;
        }
      }
    }

    std::uint32_t total;
    const std::uint32_t index = block_sum_before<kWarps>(__popc(visible), sums, total);
    if (threadIdx.x < 32) {
      const TileStatus found = sum_before(w.project_status, chunk, total);
      if (threadIdx.x == 0) {
        before = static_cast<std::uint32_t>(found);
        if ((chunk + 1) * kChunk >= active_count) {
          const std::uint32_t all = before + total;
          w.counters->visible = all;
          w.counters->splats = all <= w.splat_capacity ? all : 0;
        }
      }
    }
    __syncthreads();
    if (before + total <= w.splat_capacity) {
      std::uint32_t to = before + index;
#pragma unroll 1
      for (std::uint32_t v = 0; v < views; ++v) {
        if ((visible >> v & 1u) == 0) continue;
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
