// SPDX-License-Identifier: Apache-2.0
// The kernels of geometry/frame_warp.h. All pointers are of device memory. Nothing here waits;
// check cudaGetLastError() afterwards.
#pragma once

#include <cuda_runtime_api.h>

#include "geometry/warp_rule.h"

namespace stgs::encoder::cuda {

// Writes an image as BGR, rotated clockwise by `quarters` quarters of a turn.
void launch_yuv_to_bgr(const geometry::YuvPlanes& image, const geometry::YuvCoefficients& c,
                       const geometry::ChromaTaps* columns, const geometry::ChromaTaps* rows,
                       int quarters, std::uint8_t* out, cudaStream_t stream);
// Writes the undistorted image, of the same size and 3 channels. `positions`: per pixel.
void launch_undistort(const geometry::PackedImage& image, const geometry::WarpPosition* positions,
                      const std::int16_t* weights, std::uint8_t* out, cudaStream_t stream);
// Writes the scaled image, width x height pixels of 3 channels.
void launch_scale(const geometry::PackedImage& image, const geometry::AreaSpan* columns,
                  const geometry::AreaSpan* rows, int width, int height, std::uint8_t* out,
                  cudaStream_t stream);

}  // namespace stgs::encoder::cuda
