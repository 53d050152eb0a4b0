// SPDX-License-Identifier: Apache-2.0
// The cleaning of motion masks, as clean_mask() of init/background.cpp.
#include "backend/cuda/motion.h"
#include "backend/cuda/pixel_grid.cuh"

namespace stgs::encoder::cuda {
namespace {

// An element of morphology: pixels with |x| <= reach[|y|], as cv::getStructuringElement().
struct Element {
  int rows;
  int reach[3];
};
constexpr Element kEllipse{2, {2, 2, 0}}, kCross{1, {1, 0, 0}};

// Returns whether any pixel, or all, under the element are set. Pixels beyond the image do not
// count.
__device__ bool is_set_under(const std::uint8_t* mask, MotionSize size, const Element& element,
                             int x, int y, bool all) {
  for (int j = -element.rows; j <= element.rows; ++j) {
    if (y + j < 0 || y + j >= size.height) continue;
    const int reach = element.reach[abs(j)];
    for (int i = max(x - reach, 0); i <= min(x + reach, size.width - 1); ++i)
      if ((mask[(y + j) * size.width + i] != 0) != all) return !all;
  }
  return all;
}

__global__ void __launch_bounds__(kPixelThreads)
    morphology_kernel(MotionSize size, const std::uint8_t* from, Element element, bool erodes,
                      std::uint8_t* to) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const std::size_t start = at.frame * static_cast<std::size_t>(size.width * size.height);
  to[start + at.y * size.width + at.x] =
      is_set_under(from + start, size, element, at.x, at.y, erodes) ? 255 : 0;
}

// The last dilation, and the number of pixels.
__global__ void __launch_bounds__(kPixelThreads)
    finish_kernel(MotionSize size, const std::uint8_t* from, Element element, std::uint8_t* to,
                  int* masked) {
  const ThreadPixel at = thread_pixel();
  const bool is_inside = at.x < size.width && at.y < size.height;
  const std::size_t start = at.frame * static_cast<std::size_t>(size.width * size.height);
  const bool is_set = is_inside && is_set_under(from + start, size, element, at.x, at.y, false);
  if (is_inside) to[start + at.y * size.width + at.x] = is_set ? 255 : 0;
  const int count = __syncthreads_count(is_set ? 1 : 0);
  if (threadIdx.x == 0 && threadIdx.y == 0 && count != 0) atomicAdd(&masked[at.frame], count);
}

}  // namespace

void launch_masks(MotionSize size, const MotionMasks& all, cudaStream_t stream) {
  const dim3 grid = pixel_grid(size, all.frames);
  const auto apply = [&](const std::uint8_t* from, Element element, bool erodes, std::uint8_t* to) {
    morphology_kernel<<<grid, kPixelBlock, 0, stream>>>(size, from, element, erodes, to);
  };
  const auto select = [&](const std::uint8_t* from, std::uint8_t* to) {
    launch_select_components(size, all.frames, from, all.strong,
                             geometry::smallest_component(size.pixels()), all.labels, all.areas, to,
                             stream);
  };
  select(all.weak, all.mask);
  apply(all.mask, kEllipse, false, all.weak);
  apply(all.weak, kEllipse, true, all.mask);
  launch_fill_holes(size, all.frames, all.mask, geometry::largest_hole(size.pixels()), all.labels,
                    all.areas, stream);
  apply(all.mask, kCross, true, all.weak);
  apply(all.weak, kCross, false, all.mask);
  select(all.mask, all.weak);
  finish_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all.weak, kCross, all.mask, all.masked);
}

}  // namespace stgs::encoder::cuda
