// SPDX-License-Identifier: Apache-2.0
// Connected components of masks, by union-find over the pixels: a label is the index of a pixel of
// the same component, and that of a root is its own, the smallest of the component.
#include "backend/cuda/motion.h"
#include "backend/cuda/pixel_grid.cuh"
#include "stgs/format/math/cuda.cuh"

namespace stgs::encoder::cuda {
namespace {

using math::kAllLanes;

constexpr int kNoLabel = -1;
// Added to the area of a component that has a seed or a pixel at the border.
constexpr int kMarked = 1 << 30;

struct Components {
  const std::uint8_t* mask;
  bool of_zeros;  // the components are of the pixels that are 0
  int* labels;
  int* areas;
};

__device__ int root_of(const int* labels, int i) {
  while (labels[i] != i) i = labels[i];
  return i;
}

// The larger root gets the smaller one as its label. If another thread has changed the label of the
// larger root first, that label is joined, too.
__device__ void unite(int* labels, int a, int b) {
  for (;;) {
    a = root_of(labels, a);
    b = root_of(labels, b);
    if (a == b) return;
    if (a < b) {
      const int smaller = a;
      a = b;
      b = smaller;
    }
    const int before = atomicMin(&labels[a], b);
    if (before == a) return;
    a = before;
  }
}

__device__ bool is_member(const Components& all, int i) {
  return (all.mask[i] != 0) != all.of_zeros;
}

// Labels each pixel with the first of its run within the 32 pixels of its warp.
__global__ void __launch_bounds__(kPixelThreads) runs_kernel(MotionSize size, Components all) {
  const ThreadPixel at = thread_pixel();
  const bool is_inside = at.x < size.width && at.y < size.height;
  const int i = (at.frame * size.height + at.y) * size.width + at.x;
  const bool member = is_inside && is_member(all, i);
  const unsigned members = __ballot_sync(kAllLanes, member);
  if (!is_inside) return;
  const unsigned gaps = ~members & ((1u << threadIdx.x) - 1);
  const int start = gaps == 0 ? 0 : 32 - __clz(gaps);
  all.labels[i] = member ? i - static_cast<int>(threadIdx.x) + start : kNoLabel;
  all.areas[i] = 0;
}

// Joins runs with those to the left and above. A pixel whose left neighbour joins the same two runs
// is skipped.
template <bool kDiagonal>
__global__ void __launch_bounds__(kPixelThreads) join_kernel(MotionSize size, Components all) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const int i = (at.frame * size.height + at.y) * size.width + at.x;
  if (!is_member(all, i)) return;
  const bool left = at.x > 0 && is_member(all, i - 1);
  if (left && threadIdx.x == 0) unite(all.labels, i, i - 1);
  if (at.y == 0) return;
  const int up = i - size.width;
  const bool up_left = at.x > 0 && is_member(all, up - 1);
  if (is_member(all, up)) {
    if (!(left && up_left)) unite(all.labels, i, up);
    return;
  }
  if (!kDiagonal) return;
  if (up_left && !left) unite(all.labels, i, up - 1);
  const bool is_last = at.x + 1 == size.width;
  if (!is_last && is_member(all, up + 1) && !is_member(all, i + 1)) unite(all.labels, i, up + 1);
}

// Labels pixels with their roots, and counts them. `seeds` is null: pixels at the border mark.
__global__ void __launch_bounds__(kPixelThreads)
    measure_kernel(MotionSize size, Components all, const std::uint8_t* seeds) {
  const ThreadPixel at = thread_pixel();
  const bool is_inside = at.x < size.width && at.y < size.height;
  const int i = (at.frame * size.height + at.y) * size.width + at.x;
  const int root = is_inside && is_member(all, i) ? root_of(all.labels, i) : kNoLabel;
  const bool marks =
      root != kNoLabel && (seeds != nullptr ? seeds[i] != 0
                                            : at.x == 0 || at.y == 0 || at.x + 1 == size.width ||
                                                  at.y + 1 == size.height);
  const unsigned same = __match_any_sync(kAllLanes, root);
  const unsigned marking = __ballot_sync(kAllLanes, marks);
  if (root == kNoLabel) return;
  all.labels[i] = root;
  if (static_cast<int>(threadIdx.x) != __ffs(same) - 1) return;
  atomicAdd(&all.areas[root], __popc(same));
  if ((marking & same) != 0) atomicOr(&all.areas[root], kMarked);
}

__global__ void __launch_bounds__(kPixelThreads)
    select_kernel(MotionSize size, Components all, int smallest, std::uint8_t* out) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const int i = (at.frame * size.height + at.y) * size.width + at.x;
  const int area = all.labels[i] == kNoLabel ? 0 : all.areas[all.labels[i]];
  out[i] = area >= kMarked + smallest ? 255 : 0;
}

__global__ void __launch_bounds__(kPixelThreads)
    fill_kernel(MotionSize size, Components all, int largest, std::uint8_t* mask) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const int i = (at.frame * size.height + at.y) * size.width + at.x;
  if (all.labels[i] != kNoLabel && all.areas[all.labels[i]] <= largest) mask[i] = 255;
}

}  // namespace

void launch_select_components(MotionSize size, int frames, const std::uint8_t* mask,
                              const std::uint8_t* seeds, int smallest, int* labels, int* areas,
                              std::uint8_t* out, cudaStream_t stream) {
  const dim3 grid = pixel_grid(size, frames);
  const Components all{mask, false, labels, areas};
  runs_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all);
  join_kernel<true><<<grid, kPixelBlock, 0, stream>>>(size, all);
  measure_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all, seeds);
  select_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all, smallest, out);
}

void launch_fill_holes(MotionSize size, int frames, std::uint8_t* mask, int largest, int* labels,
                       int* areas, cudaStream_t stream) {
  const dim3 grid = pixel_grid(size, frames);
  const Components all{mask, true, labels, areas};
  runs_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all);
  join_kernel<false><<<grid, kPixelBlock, 0, stream>>>(size, all);
  measure_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all, nullptr);
  fill_kernel<<<grid, kPixelBlock, 0, stream>>>(size, all, largest, mask);
}

}  // namespace stgs::encoder::cuda
