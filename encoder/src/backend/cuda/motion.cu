// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/motion.h"

#include "backend/cuda/pixel_grid.cuh"
#include "geometry/masked_median.h"

namespace stgs::encoder::cuda {
namespace {

using geometry::kLengthBins;
using geometry::kMaskReach;
using geometry::kMaxMedianSamples;

constexpr int kMaxSamples = static_cast<int>(kMaxMedianSamples);

__device__ bool is_masked_near(const std::uint8_t* mask, MotionSize size, int x, int y) {
  for (int j = max(y - kMaskReach, 0); j <= min(y + kMaskReach, size.height - 1); ++j) {
    for (int i = max(x - kMaskReach, 0); i <= min(x + kMaskReach, size.width - 1); ++i)
      if (mask[j * size.width + i] != 0) return true;
  }
  return false;
}

// Returns the value of rank `rank` in each byte of the samples, bit by bit: the largest value that
// at most `rank` samples are below.
__device__ std::uint32_t packed_rank(const std::uint32_t (&samples)[kMaxSamples], int rank) {
  std::uint32_t found = 0;
#pragma unroll
  for (int bit = 7; bit >= 0; --bit) {
    const std::uint32_t tried = found | 0x01010101u << bit;
    std::uint32_t below = 0;
#pragma unroll
    for (int s = 0; s < kMaxSamples; ++s) below += __vcmpltu4(samples[s], tried) & 0x01010101u;
    const std::uint32_t is_lower = __vcmpgtu4(below, 0x01010101u * static_cast<unsigned>(rank));
    found = (tried & ~is_lower) | (found & is_lower);
  }
  return found;
}

// Loads a pixel of the samples. One that does not count is 255, which is sorted last. Returns a bit
// for each that counts.
__device__ unsigned load_samples(MotionSize size, const DeviceSamples& from, int x, int y,
                                 std::uint32_t (&samples)[kMaxSamples]) {
  const std::size_t pixels = size.width * size.height, pixel = y * size.width + x;
  unsigned counted = 0;
#pragma unroll
  for (int s = 0; s < kMaxSamples; ++s) {
    samples[s] = 0xffffffffu;
    if (s >= from.count) continue;
    if (from.masks != nullptr && is_masked_near(from.masks + s * pixels, size, x, y)) continue;
    const std::uint8_t* const rgb = from.rgb + 3 * (s * pixels + pixel);
    samples[s] = rgb[0] | rgb[1] << 8 | rgb[2] << 16 | 0xff000000u;
    counted |= 1u << s;
  }
  return counted;
}

__global__ void __launch_bounds__(kPixelThreads)
    median_kernel(MotionSize size, DeviceSamples from, std::uint8_t* colour, std::uint8_t* valid,
                  std::uint32_t* deviations) {
  __shared__ std::uint32_t deviating[256];
  static_assert(kPixelThreads == 256);
  const int thread = threadIdx.y * kPixelX + threadIdx.x;
  deviating[thread] = 0;
  __syncthreads();
  const ThreadPixel at = thread_pixel();
  if (at.x < size.width && at.y < size.height) {
    const std::size_t pixel = at.y * size.width + at.x;
    std::uint32_t samples[kMaxSamples];
    const unsigned counted = load_samples(size, from, at.x, at.y, samples);
    const int rank = __popc(counted) / 2;
    const std::uint32_t median = counted != 0 ? packed_rank(samples, rank) : 0;
    for (int c = 0; c < 3; ++c) colour[3 * pixel + c] = median >> 8 * c & 0xff;
    valid[pixel] = counted != 0 ? 255 : 0;
    const int green = median >> 8 & 0xff;
#pragma unroll
    for (int s = 0; s < kMaxSamples; ++s) {
      const int deviation = abs(static_cast<int>(samples[s] >> 8 & 0xff) - green);
      samples[s] = (counted >> s & 1) != 0 ? static_cast<std::uint32_t>(deviation) : 0xffu;
    }
    if (counted != 0) atomicAdd(&deviating[packed_rank(samples, rank) & 0xff], 1u);
  }
  __syncthreads();
  if (deviating[thread] != 0) atomicAdd(&deviations[thread], deviating[thread]);
}

__global__ void __launch_bounds__(kPixelThreads)
    blur_kernel(MotionSize size, DeviceBackground background) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const int pixel = at.y * size.width + at.x;
  for (int c = 0; c < 3; ++c) {
    background.blurred[3 * pixel + c] =
        geometry::blurred_at(background.colour, 3, size.width, size.height, at.x, at.y, c);
  }
  background.grey[pixel] = geometry::grey_level_of(background.colour + 3 * pixel);
}

__global__ void __launch_bounds__(kPixelThreads)
    blur_grey_kernel(MotionSize size, const std::uint8_t* grey, std::uint8_t* blurred) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  blurred[at.y * size.width + at.x] =
      geometry::blurred_at(grey, 1, size.width, size.height, at.x, at.y, 0);
}

__global__ void __launch_bounds__(kPixelThreads)
    threshold_kernel(MotionSize size, const std::uint8_t* grey, float base, float* threshold) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  int slope = 0;
  for (int j = max(at.y - 1, 0); j <= min(at.y + 1, size.height - 1); ++j) {
    for (int i = max(at.x - 1, 0); i <= min(at.x + 1, size.width - 1); ++i)
      slope = max(slope, geometry::squared_slope_at(grey, size.width, size.height, i, j));
  }
  threshold[at.y * size.width + at.x] = geometry::change_threshold_of(slope, base);
}

__global__ void __launch_bounds__(kPixelThreads)
    changes_kernel(MotionSize size, DeviceBackground background, MotionMasks masks) {
  const ThreadPixel at = thread_pixel();
  if (at.x >= size.width || at.y >= size.height) return;
  const std::size_t pixels = size.width * size.height, pixel = at.y * size.width + at.x;
  const std::uint8_t* const rgb = masks.rgb + 3 * pixels * masks.slots.at(at.frame);
  int change = 0;
  for (int c = 0; c < 3; ++c) {
    const int value = geometry::blurred_at(rgb, 3, size.width, size.height, at.x, at.y, c);
    change = max(change, abs(value - background.blurred[3 * pixel + c]));
  }
  const std::size_t i = at.frame * pixels + pixel;
  const bool is_flowing = (masks.moving[i] | masks.moving[i + pixels]) != 0;
  const float threshold = background.threshold[pixel], value = static_cast<float>(change);
  masks.weak[i] = geometry::is_weak_change(value, threshold, is_flowing) ? 255 : 0;
  masks.strong[i] = geometry::is_strong_change(value, threshold, is_flowing) ? 255 : 0;
}

__global__ void __launch_bounds__(kPixelThreads) lengths_kernel(MotionSize size, CheckedFlow all) {
  __shared__ std::uint32_t counts[kLengthBins];
  static_assert(kLengthBins == kPixelThreads);
  const int thread = threadIdx.y * blockDim.x + threadIdx.x;
  counts[thread] = 0;
  __syncthreads();
  const ThreadPixel at = thread_pixel();
  const int x = 2 * at.x, y = 2 * at.y;
  if (x < size.width && y < size.height) {
    const std::size_t pixels = size.width * size.height;
    const Vec2 flow = all.flow[at.frame * pixels + y * size.width + x];
    if (flow.x == flow.x)
      atomicAdd(&counts[geometry::length_bin_of(geometry::flow_length(flow))], 1u);
  }
  __syncthreads();
  if (counts[thread] != 0) atomicAdd(&all.lengths[at.frame * kLengthBins + thread], counts[thread]);
}

// Each block finds the median of the lengths: the number of bins that, with those before, have at
// most half of them.
__global__ void __launch_bounds__(kPixelThreads)
    moving_kernel(MotionSize size, CheckedFlow all, std::uint8_t* moving) {
  __shared__ std::uint32_t sums[kLengthBins];
  const int thread = threadIdx.y * blockDim.x + threadIdx.x;
  const ThreadPixel at = thread_pixel();
  sums[thread] = all.lengths[at.frame * kLengthBins + thread];
  for (int step = 1; step < kLengthBins; step *= 2) {
    __syncthreads();
    const std::uint32_t before = thread >= step ? sums[thread - step] : 0;
    __syncthreads();
    sums[thread] += before;
  }
  __syncthreads();
  const std::uint32_t total = sums[kLengthBins - 1];
  const int median = __syncthreads_count(sums[thread] <= total / 2 ? 1 : 0);
  const float longest = geometry::moving_length_of(geometry::binned_length(median));
  if (at.x >= size.width || at.y >= size.height) return;
  const std::size_t i =
      at.frame * static_cast<std::size_t>(size.width * size.height) + at.y * size.width + at.x;
  moving[i] = total > 0 && geometry::flow_length(all.flow[i]) > longest ? 255 : 0;
}

__global__ void __launch_bounds__(kPixelThreads)
    pack_kernel(MotionSize size, CheckedFlow all, const std::uint8_t* masks, std::int16_t* packed) {
  const ThreadPixel at = thread_pixel();
  const int columns = (size.width + 1) / 2, rows = (size.height + 1) / 2;
  if (at.x >= columns || at.y >= rows) return;
  const std::size_t i = at.frame * static_cast<std::size_t>(size.width * size.height) +
                        2 * at.y * size.width + 2 * at.x;
  const Vec2 flow = all.flow[i];
  const bool is_known = masks[i] != 0 && geometry::is_known_flow(flow);
  std::int16_t* const out =
      packed + 2 * ((at.frame * static_cast<std::size_t>(rows) + at.y) * columns + at.x);
  out[0] = is_known ? geometry::packed_flow(flow.x) : geometry::kUnknownFlow;
  out[1] = is_known ? geometry::packed_flow(flow.y) : geometry::kUnknownFlow;
}

}  // namespace

void launch_median(MotionSize size, const DeviceSamples& samples, std::uint8_t* colour,
                   std::uint8_t* valid, std::uint32_t* deviations, cudaStream_t stream) {
  median_kernel<<<pixel_grid(size, 1), kPixelBlock, 0, stream>>>(size, samples, colour, valid,
                                                                 deviations);
}

void launch_background(MotionSize size, const DeviceBackground& background, float base,
                       cudaStream_t stream) {
  const dim3 grid = pixel_grid(size, 1);
  blur_kernel<<<grid, kPixelBlock, 0, stream>>>(size, background);
  blur_grey_kernel<<<grid, kPixelBlock, 0, stream>>>(size, background.grey,
                                                     background.blurred_grey);
  threshold_kernel<<<grid, kPixelBlock, 0, stream>>>(size, background.blurred_grey, base,
                                                     background.threshold);
}

void launch_changes(MotionSize size, const DeviceBackground& background, const MotionMasks& masks,
                    cudaStream_t stream) {
  changes_kernel<<<pixel_grid(size, masks.frames), kPixelBlock, 0, stream>>>(size, background,
                                                                             masks);
}

void launch_flow_lengths(MotionSize size, const CheckedFlow& flow, cudaStream_t stream) {
  const MotionSize half{(size.width + 1) / 2, (size.height + 1) / 2};
  lengths_kernel<<<pixel_grid(half, flow.pairs), kPixelBlock, 0, stream>>>(size, flow);
}

void launch_moving(MotionSize size, const CheckedFlow& flow, std::uint8_t* moving,
                   cudaStream_t stream) {
  moving_kernel<<<pixel_grid(size, flow.pairs), kPixelBlock, 0, stream>>>(size, flow, moving);
}

void launch_pack_flow(MotionSize size, const CheckedFlow& flow, const std::uint8_t* masks,
                      std::int16_t* packed, cudaStream_t stream) {
  const MotionSize half{(size.width + 1) / 2, (size.height + 1) / 2};
  pack_kernel<<<pixel_grid(half, flow.pairs), kPixelBlock, 0, stream>>>(size, flow, masks, packed);
}

}  // namespace stgs::encoder::cuda
