// SPDX-License-Identifier: Apache-2.0
// TrainBackend::limit_scales: one thread per primitive, for a group of cameras at a time.
#include <algorithm>

#include "backend/cuda/device.cuh"
#include "math/scale_limit.h"

namespace stgs::encoder::cuda {
namespace {

using namespace math;

constexpr int kBlock = 256;
constexpr std::size_t kMaxCameras = 32;  // of a launch, whose arguments they are

struct CameraGroup {
  PinholeCamera cameras[kMaxCameras];
  int count;
};

__global__ void __launch_bounds__(kBlock)
    limit(const Primitives p, const CameraGroup group, float pixels) {
  const std::uint32_t i = blockIdx.x * kBlock + threadIdx.x;
  if (i >= p.n) return;
  const float* x = p.values[kPosition] + 3 * i;
  const Vec3 position{x[0], x[1], x[2]};
  float rate = 0.0f;
  for (int c = 0; c < group.count; ++c)
    rate = fmaxf(rate, sampling_rate(group.cameras[c], position));
  if (!(rate > 0.0f)) return;
  const float least = logf(pixels / rate);
  float* log_scale = p.values[kLogScale] + 3 * i;
  for (int k = 0; k < 3; ++k) log_scale[k] = fmaxf(log_scale[k], least);
}

}  // namespace

void launch_limit_scales(const Primitives& p, std::span<const PinholeCamera> cameras, float pixels,
                         cudaStream_t stream) {
  for (std::size_t first = 0; first < cameras.size(); first += kMaxCameras) {
    CameraGroup group{};
    const std::size_t count = std::min(kMaxCameras, cameras.size() - first);
    std::copy_n(cameras.begin() + first, count, group.cameras);
    group.count = static_cast<int>(count);
    limit<<<blocks_of(p.n, kBlock), kBlock, 0, stream>>>(p, group, pixels);
  }
}

}  // namespace stgs::encoder::cuda
