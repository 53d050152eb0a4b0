// SPDX-License-Identifier: Apache-2.0
#include "cuda/launch.cuh"
#include "cuda/pack_pixels.h"

namespace stgs::player::cuda {
namespace {

constexpr int kSide = 16;  // of a thread block, pixels

__device__ unsigned char to_byte(float value) {
  return static_cast<unsigned char>(fminf(fmaxf(value, 0.0f), 1.0f) * 255.0f + 0.5f);
}

__global__ void __launch_bounds__(kSide* kSide)
    pack(const float* planes, int width, int height, unsigned char* to, std::size_t stride) {
  const int thread = static_cast<int>(threadIdx.x);
  const int x = static_cast<int>(blockIdx.x) * kSide + thread % kSide;
  const int y = static_cast<int>(blockIdx.y) * kSide + thread / kSide;
  if (x >= width || y >= height) return;
  const std::size_t plane = static_cast<std::size_t>(width) * height;
  const float* const from = planes + static_cast<std::size_t>(y) * width + x;
  reinterpret_cast<uchar4*>(to + y * stride)[x] = make_uchar4(
      to_byte(from[0]), to_byte(from[plane]), to_byte(from[2 * plane]), to_byte(from[3 * plane]));
}

}  // namespace

cudaError_t pack_pixels(const float* planes, int width, int height, void* to, std::size_t stride,
                        cudaStream_t stream) {
  const auto blocks = [](int pixels) {
    return static_cast<unsigned>((pixels + kSide - 1) / kSide);
  };
  launch(pack, dim3(blocks(width), blocks(height)), kSide * kSide, stream, planes, width, height,
         static_cast<unsigned char*>(to), stride);
  return cudaGetLastError();
}

}  // namespace stgs::player::cuda
