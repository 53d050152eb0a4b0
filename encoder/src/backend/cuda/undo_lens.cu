// SPDX-License-Identifier: Apache-2.0
// train/undo_lens.h on the GPU.
#include "backend/cuda/device.cuh"
#include "train/undo_lens_pixel.h"

namespace stgs::encoder::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    undo(const View view, const math::Lens lens, const std::uint8_t* image, std::uint8_t* out) {
  const int q = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
  if (q >= view.width * view.height) return;
  const LensSample sample = lens_sample(view.camera, lens, q % view.width, q / view.width);
#pragma unroll
  for (int c = 0; c < 3; ++c) out[std::size_t{3} * q + c] = sampled(image, sample, c);
}

// Each block writes its sum.
__global__ void __launch_bounds__(kThreads)
    vignetting(const View view, const float4* image, const float4* d_image, float* sums) {
  float sum = 0.0f;
  for (int q = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
       q < view.width * view.height; q += kLensBlocks * kThreads) {
    const float4 colour = image[q], d = d_image[q];
    math::Vec2 pixel;
    pixel.x = static_cast<float>(q % view.width) + 0.5f;
    pixel.y = static_cast<float>(q / view.width) + 0.5f;
    sum +=
        (colour.x * d.x + colour.y * d.y + colour.z * d.z) * math::lens_radius2(view.camera, pixel);
  }
  sum = block_sum<kThreads>(sum);
  if (threadIdx.x == 0) sums[1 + blockIdx.x] = sum;
}

__global__ void add_sums(float* sums) {
  double sum = 0.0;
  for (int block = static_cast<int>(threadIdx.x); block < kLensBlocks; block += 32)
    sum += sums[1 + block];
  sum = warp_sum(sum);
  if (threadIdx.x == 0) sums[0] = static_cast<float>(sum);
}

}  // namespace

void launch_undo_lens(const View& view, const math::Lens& lens, const std::uint8_t* image,
                      const Workspace& w, cudaStream_t stream) {
  const int blocks = blocks_of(std::size_t{1} * view.width * view.height, kThreads);
  undo<<<blocks, kThreads, 0, stream>>>(view, lens, image, w.without_lens);
}

void launch_vignetting_gradient(const View& view, const Workspace& w, cudaStream_t stream) {
  vignetting<<<kLensBlocks, kThreads, 0, stream>>>(view, w.image, w.d_image, w.lens_sums);
  add_sums<<<1, 32, 0, stream>>>(w.lens_sums);
}

}  // namespace stgs::encoder::cuda
