// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/frame_warp.h"

namespace stgs::encoder::cuda {
namespace {

using geometry::AreaSpan;
using geometry::ChromaTaps;
using geometry::PackedImage;
using geometry::WarpPosition;
using geometry::YuvCoefficients;
using geometry::YuvPlanes;

constexpr dim3 kBlock(32, 8);

dim3 blocks_for(int width, int height) {
  return {(static_cast<unsigned>(width) + kBlock.x - 1) / kBlock.x,
          (static_cast<unsigned>(height) + kBlock.y - 1) / kBlock.y};
}

// Sets the pixel of the thread, and returns whether there is one.
__device__ bool pixel_of_thread(int width, int height, int& x, int& y) {
  x = static_cast<int>(blockIdx.x * kBlock.x + threadIdx.x);
  y = static_cast<int>(blockIdx.y * kBlock.y + threadIdx.y);
  return x < width && y < height;
}

__global__ void yuv_kernel(YuvPlanes image, YuvCoefficients c, const ChromaTaps* columns,
                           const ChromaTaps* rows, int quarters, std::uint8_t* out) {
  int x, y;
  if (!pixel_of_thread(image.width, image.height, x, y)) return;
  const geometry::Bgr pixel = geometry::yuv_pixel(image, c, columns[x], rows[y], x, y);
  std::uint8_t* const to =
      out + 3 * geometry::rotated_index(quarters, image.width, image.height, x, y);
  to[0] = pixel.b;
  to[1] = pixel.g;
  to[2] = pixel.r;
}

__global__ void undistort_kernel(PackedImage image, const WarpPosition* positions,
                                 const std::int16_t* weights, std::uint8_t* out) {
  int x, y;
  if (!pixel_of_thread(image.width, image.height, x, y)) return;
  const std::size_t at = std::size_t{1} * y * image.width + x;
  for (int c = 0; c < 3; ++c)
    out[3 * at + c] = geometry::warped_sample(image, positions[at], weights, c);
}

__global__ void scale_kernel(PackedImage image, const AreaSpan* columns, const AreaSpan* rows,
                             int width, int height, std::uint8_t* out) {
  int x, y;
  if (!pixel_of_thread(width, height, x, y)) return;
  const std::size_t at = std::size_t{1} * y * width + x;
  for (int c = 0; c < 3; ++c)
    out[3 * at + c] = geometry::area_sample(image, columns[x], rows[y], c);
}

}  // namespace

void launch_yuv_to_bgr(const YuvPlanes& image, const YuvCoefficients& c, const ChromaTaps* columns,
                       const ChromaTaps* rows, int quarters, std::uint8_t* out,
                       cudaStream_t stream) {
  yuv_kernel<<<blocks_for(image.width, image.height), kBlock, 0, stream>>>(image, c, columns, rows,
                                                                           quarters, out);
}

void launch_undistort(const PackedImage& image, const WarpPosition* positions,
                      const std::int16_t* weights, std::uint8_t* out, cudaStream_t stream) {
  undistort_kernel<<<blocks_for(image.width, image.height), kBlock, 0, stream>>>(image, positions,
                                                                                 weights, out);
}

void launch_scale(const PackedImage& image, const AreaSpan* columns, const AreaSpan* rows,
                  int width, int height, std::uint8_t* out, cudaStream_t stream) {
  scale_kernel<<<blocks_for(width, height), kBlock, 0, stream>>>(image, columns, rows, width,
                                                                 height, out);
}

}  // namespace stgs::encoder::cuda
