// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

namespace stgs::player::cuda {

// Red, green, blue and alpha of a picture's planes, one after the other, as 4 bytes a pixel,
// rounded as the host rounds; `to` and `stride`, bytes, are multiples of 4.
cudaError_t pack_pixels(const float* planes, int width, int height, void* to, std::size_t stride,
                        cudaStream_t stream);

}  // namespace stgs::player::cuda
