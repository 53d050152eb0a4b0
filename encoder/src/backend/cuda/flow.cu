// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/flow.h"

#include <algorithm>

#include "backend/cuda/pixel_grid.cuh"

namespace stgs::encoder::cuda {
namespace {

using geometry::FlowField;
using geometry::FlowLevel;
using geometry::PatchFlow;
using geometry::PatchGrid;

constexpr int kPatchThreads = 64;

__global__ void __launch_bounds__(kPixelThreads)
    grey_kernel(MotionSize size, const std::uint8_t* rgb, MotionSlots slots, int first,
                float* grey) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const std::size_t i =
      slots.at(first + at.frame) * size.width * size.height + at.y * size.width + at.x;
  grey[i] = static_cast<float>(geometry::grey_level_of(rgb + 3 * i));
}

__global__ void __launch_bounds__(kPixelThreads)
    half_kernel(MotionSize fine, MotionSize half, MotionSlots slots, int first, const float* from,
                float* to) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= half.width || at.y >= half.height) return;
  const std::size_t slot = slots.at(first + at.frame);
  to[slot * half.width * half.height + at.y * half.width + at.x] =
      geometry::half_size_grey(from + slot * fine.width * fine.height, fine.width, at.x, at.y);
}

__global__ void __launch_bounds__(kPixelThreads)
    gradient_kernel(MotionSize size, MotionSlots slots, int first, const float* grey,
                    Vec2* gradient) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const std::size_t start = slots.at(first + at.frame) * size.width * size.height;
  gradient[start + at.y * size.width + at.x] =
      geometry::grey_gradient(grey + start, size.width, size.height, at.x, at.y);
}

// A level of all pairs. Part 2 k of the arrays is the flow from image k to the next, and part
// 2 k + 1 that back.
struct LevelPairs {
  MotionSize size;
  MotionSlots slots;
  const float* grey;
  const Vec2* gradient;
  int columns, rows;  // of patches

  __device__ std::size_t image(int part, bool other) const {
    const int k = part / 2 + ((part & 1) != (other ? 1 : 0) ? 1 : 0);
    return slots.at(k) * size.width * size.height;
  }
  __device__ FlowLevel from(int part) const {
    const std::size_t start = image(part, false);
    return {grey + start, gradient + start, size.width, size.height};
  }
  __device__ const float* to(int part) const { return grey + image(part, true); }
  __device__ std::size_t patches(int part) const {
    return static_cast<std::size_t>(part) * columns * rows;
  }
};

__device__ FlowField part_of(const Vec2* field, MotionSize size, int part) {
  return {field + static_cast<std::size_t>(part) * size.width * size.height, size.width,
          size.height};
}

// Starts the patches from the coarser level; `coarser` is null for the coarsest.
__global__ void __launch_bounds__(kPatchThreads)
    first_kernel(LevelPairs level, const Vec2* coarser, MotionSize coarser_size,
                 PatchFlow* patches) {
  const int patch = blockIdx.x * kPatchThreads + threadIdx.x, part = blockIdx.y;
  if (patch >= level.columns * level.rows) return;
  const FlowField start =
      coarser == nullptr ? FlowField{nullptr, 0, 0} : part_of(coarser, coarser_size, part);
  patches[level.patches(part) + patch] = geometry::first_patch_flow(
      level.from(part), level.to(part), start, patch % level.columns, patch / level.columns);
}

__global__ void __launch_bounds__(kPatchThreads)
    next_kernel(LevelPairs level, const PatchFlow* from, PatchFlow* to) {
  const int patch = blockIdx.x * kPatchThreads + threadIdx.x, part = blockIdx.y;
  if (patch >= level.columns * level.rows) return;
  const PatchGrid grid{from + level.patches(part), level.columns, level.rows};
  to[level.patches(part) + patch] = geometry::next_patch_flow(
      level.from(part), level.to(part), grid, patch % level.columns, patch / level.columns);
}

__global__ void __launch_bounds__(kPixelThreads)
    dense_kernel(LevelPairs level, const PatchFlow* patches, Vec2* field) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= level.size.width || at.y >= level.size.height) return;
  const int part = at.frame;
  const PatchGrid grid{patches + level.patches(part), level.columns, level.rows};
  field[(static_cast<std::size_t>(part) * level.size.height + at.y) * level.size.width + at.x] =
      geometry::dense_flow(level.from(part), level.to(part), grid, at.x, at.y);
}

__global__ void __launch_bounds__(kPixelThreads)
    check_kernel(MotionSize size, const Vec2* field, MotionSize field_size, int level, Vec2* flow) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  flow[(static_cast<std::size_t>(at.frame) * size.height + at.y) * size.width + at.x] =
      geometry::checked_flow(part_of(field, field_size, 2 * at.frame),
                             part_of(field, field_size, 2 * at.frame + 1), level, size.width,
                             size.height, at.x, at.y);
}

int patches_of(MotionSize size) {
  return geometry::patches_along(size.width) * geometry::patches_along(size.height);
}

}  // namespace

std::size_t flow_field_values(const FlowPyramid& pyramid) {
  return static_cast<std::size_t>(pyramid.size[pyramid.finest].pixels());
}

std::size_t flow_patches(const FlowPyramid& pyramid) {
  return static_cast<std::size_t>(patches_of(pyramid.size[pyramid.finest]));
}

void launch_pyramid(const FlowPyramid& pyramid, const std::uint8_t* rgb, MotionSlots slots,
                    int first, int last, cudaStream_t stream) {
  const int images = last - first;
  if (images == 0) return;
  grey_kernel<<<pixel_grid(pyramid.size[0], images), kPixelBlock, 0, stream>>>(
      pyramid.size[0], rgb, slots, first, pyramid.grey[0]);
  for (int l = 1; l < pyramid.levels; ++l) {
    half_kernel<<<pixel_grid(pyramid.size[l], images), kPixelBlock, 0, stream>>>(
        pyramid.size[l - 1], pyramid.size[l], slots, first, pyramid.grey[l - 1], pyramid.grey[l]);
  }
  for (int l = pyramid.finest; l < pyramid.levels; ++l) {
    gradient_kernel<<<pixel_grid(pyramid.size[l], images), kPixelBlock, 0, stream>>>(
        pyramid.size[l], slots, first, pyramid.grey[l], pyramid.gradient[l]);
  }
}

void launch_flow(MotionSize size, const FlowPyramid& pyramid, MotionSlots slots,
                 const FlowScratch& scratch, const CheckedFlow& flow, cudaStream_t stream) {
  if (flow.pairs == 0) return;
  const Vec2* coarser = nullptr;
  MotionSize coarser_size{0, 0};
  Vec2 *field = scratch.field[0], *other = scratch.field[1];
  for (int l = pyramid.levels - 1; l >= pyramid.finest; --l) {
    const LevelPairs level{pyramid.size[l],
                           slots,
                           pyramid.grey[l],
                           pyramid.gradient[l],
                           geometry::patches_along(pyramid.size[l].width),
                           geometry::patches_along(pyramid.size[l].height)};
    const int parts = 2 * flow.pairs;
    const dim3 grid((patches_of(level.size) + kPatchThreads - 1) / kPatchThreads, parts);
    PatchFlow *from = scratch.patches[0], *to = scratch.patches[1];
    first_kernel<<<grid, kPatchThreads, 0, stream>>>(level, coarser, coarser_size, from);
    for (int k = 1; k < geometry::kFlowRounds; ++k) {
      next_kernel<<<grid, kPatchThreads, 0, stream>>>(level, from, to);
      std::swap(from, to);
    }
    dense_kernel<<<pixel_grid(level.size, parts), kPixelBlock, 0, stream>>>(level, from, field);
    coarser = field;
    coarser_size = level.size;
    std::swap(field, other);
  }
  check_kernel<<<pixel_grid(size, flow.pairs), kPixelBlock, 0, stream>>>(
      size, coarser, coarser_size, pyramid.finest, flow.flow);
}

}  // namespace stgs::encoder::cuda
