// SPDX-License-Identifier: Apache-2.0
// Launches with one thread per pixel of several images.
#pragma once

#include <cuda_runtime.h>

#include "backend/cuda/motion.h"

namespace stgs::encoder::cuda {

// A warp has 32 pixels of a row.
inline constexpr int kPixelX = 32, kPixelY = 8;
inline constexpr int kPixelThreads = kPixelX * kPixelY;
inline const dim3 kPixelBlock(kPixelX, kPixelY);

inline dim3 pixel_grid(MotionSize size, int frames) {
  return {static_cast<unsigned>((size.width + kPixelX - 1) / kPixelX),
          static_cast<unsigned>((size.height + kPixelY - 1) / kPixelY),
          static_cast<unsigned>(frames)};
}

struct ThreadPixel {
  int x, y, frame;
};
__device__ inline ThreadPixel thread_pixel() {
  return {static_cast<int>(blockIdx.x * kPixelX + threadIdx.x),
          static_cast<int>(blockIdx.y * kPixelY + threadIdx.y), static_cast<int>(blockIdx.z)};
}

}  // namespace stgs::encoder::cuda
