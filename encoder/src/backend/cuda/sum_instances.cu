// SPDX-License-Identifier: Apache-2.0
// Sums the partials of the backward blend over the instances of each primitive. Eight lanes share a
// primitive, because a few have hundreds of times as many instances as others. The order of the
// sums depends only on the number of instances.
#include "backend/cuda/device.cuh"

namespace stgs::encoder::cuda {
namespace {

constexpr int kBlock = 256;
constexpr int kLanes = 8;  // per primitive

__device__ void add(float4& sum, const float4& x) {
  sum.x += x.x;
  sum.y += x.y;
  sum.z += x.z;
  sum.w += x.w;
}

// Returns the sum over the lanes of a primitive to all of them.
__device__ float4 sum_lanes(float4 x) {
#pragma unroll
  for (int step = kLanes / 2; step > 0; step /= 2) {
    add(x,
        make_float4(__shfl_xor_sync(kAllLanes, x.x, step), __shfl_xor_sync(kAllLanes, x.y, step),
                    __shfl_xor_sync(kAllLanes, x.z, step), __shfl_xor_sync(kAllLanes, x.w, step)));
  }
  return x;
}

// Writes kVectors sums of 4 floats for a primitive. All lanes of the warp call it; `range` is empty
// for those without a primitive.
template <int kVectors>
__device__ void sum_range(uint2 range, const float4* instances, float4* out) {
  const std::uint32_t lane = threadIdx.x % kLanes;
  float4 sums[kVectors] = {};
#pragma unroll 4
  for (std::uint32_t k = lane; k < range.y; k += kLanes) {
    const float4* from = instances + std::size_t{kVectors} * (range.x + k);
#pragma unroll
    for (int v = 0; v < kVectors; ++v) add(sums[v], __ldg(from + v));
  }
#pragma unroll
  for (int v = 0; v < kVectors; ++v) {
    const float4 sum = sum_lanes(sums[v]);
    if (lane == 0 && out != nullptr) out[v] = sum;
  }
}

template <bool kPlanes>
__global__ void __launch_bounds__(kBlock)
    sum_instances(std::uint32_t n, const std::uint32_t* updates, const Workspace w) {
  const std::uint32_t i = (blockIdx.x * kBlock + threadIdx.x) / kLanes;
  const bool is_summed = w.counters->overflow == 0 && i < n && w.depth_keys[i] != kInvisible &&
                         (updates == nullptr || updates[i] != kFixed);
  const uint2 range = is_summed ? w.ranges[i] : make_uint2(0, 0);
  sum_range<kSums / 4>(range, reinterpret_cast<const float4*>(w.partials),
                       is_summed ? w.sums + std::size_t{kSums / 4} * i : nullptr);
  if constexpr (kPlanes)
    sum_range<1>(range, w.plane_partials, is_summed ? w.plane_sums + i : nullptr);
}

}  // namespace

void launch_sum_instances(const Primitives& p, const View& view, const Workspace& w,
                          cudaStream_t stream) {
  // Fixed primitives have a gradient of the camera only.
  const std::uint32_t* updates = view.gather_camera ? nullptr : p.updates;
  const int blocks = blocks_of(std::size_t{kLanes} * p.n, kBlock);
  const auto kernel = view.planes ? sum_instances<true> : sum_instances<false>;
  kernel<<<blocks, kBlock, 0, stream>>>(p.n, updates, w);
}

}  // namespace stgs::encoder::cuda
