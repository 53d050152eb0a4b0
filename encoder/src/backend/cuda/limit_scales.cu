// SPDX-License-Identifier: Apache-2.0
// TrainBackend::limit_scales: one thread per primitive.
#include "backend/cuda/device.cuh"
#include "math/scale_limit.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kBlock = 256;

__global__ void __launch_bounds__(kBlock)
    limit(const Primitives p, const PinholeCamera* cameras, std::uint32_t count, float pixels) {
  const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
  if (i >= p.n || p.updates[i] == kFixed) return;
  const Vec3 position = read3(p.values[kPosition], i);
  float rate = 0.0f;
  for (std::uint32_t c = 0; c < count; ++c) rate = fmaxf(rate, sampling_rate(cameras[c], position));
  if (!(rate > 0.0f)) return;
  const float least = logf(pixels / rate);
  float* log_scale = p.values[kLogScale] + 3 * i;
  for (int k = 0; k < 3; ++k) log_scale[k] = fmaxf(log_scale[k], least);
}

}  // namespace

void launch_limit_scales(const Primitives& p, const PinholeCamera* cameras, std::uint32_t count,
                         float pixels, cudaStream_t stream) {
  limit<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, cameras, count, pixels);
}

}  // namespace stgs::encoder::cuda
