// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>

namespace stgs::player::cuda {

// Starts packing the contiguous planes red, green, blue and alpha of an image into 4 bytes per
// pixel, with the rounding of the host. `to` and `stride` (bytes) are multiples of 4.
cudaError_t pack_pixels(const float* planes, int width, int height, void* to, std::size_t stride,
                        cudaStream_t stream);

}  // namespace stgs::player::cuda
