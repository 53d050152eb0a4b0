// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/perceptual_kernels.h"

#include <algorithm>

#include "backend/cuda/device.cuh"
#include "perceptual/feature_constants.h"

namespace stgs::encoder::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kWarps = kThreads / 32;

__device__ constexpr float kMean[3] = {kInputMean[0], kInputMean[1], kInputMean[2]};
__device__ constexpr float kInverse[3] = {1.0f / kInputDeviation[0], 1.0f / kInputDeviation[1],
                                          1.0f / kInputDeviation[2]};

int grid(std::size_t items, int block) {
  return std::min(blocks_of(items, block), kPerceptualBlocks);
}

// Returns the image index of pixel q of the patch.
__device__ std::size_t image_index(const PerceptualStep& step, std::size_t q) {
  const std::size_t x = q % step.patch.width, y = q / step.patch.width;
  return (step.patch.y + y) * step.width + step.patch.x + x;
}

__global__ void __launch_bounds__(kThreads)
    load_input(const PerceptualStep step, std::size_t pixels, float4* input) {
  const std::size_t q = std::size_t{blockIdx.x} * kThreads + threadIdx.x;
  if (q >= pixels) return;
  const std::size_t at = image_index(step, q);
  const float4 colour = step.image[at];
  float rendered[3], ground_truth[3];
#pragma unroll
  for (int c = 0; c < 3; ++c) {
    const float* row = step.colour_map + 3 * c;
    const float x =
        row[0] * colour.x + row[1] * colour.y + row[2] * colour.z + step.colour_map[9 + c];
    rendered[c] = (x - kMean[c]) * kInverse[c];
    const float y = static_cast<float>(step.ground_truth[3 * at + c]) * (1.0f / 255.0f);
    ground_truth[c] = (y - kMean[c]) * kInverse[c];
  }
  input[q] = make_float4(rendered[0], rendered[1], rendered[2], 0.0f);
  input[pixels + q] = make_float4(ground_truth[0], ground_truth[1], ground_truth[2], 0.0f);
}

// Like fmaxf, but propagates NaN.
__device__ float larger(float a, float b) {
  return a > b || isnan(a) ? a : b;
}

__device__ float4 larger(const float4& a, const float4& b) {
  return make_float4(larger(a.x, b.x), larger(a.y, b.y), larger(a.z, b.z), larger(a.w, b.w));
}

// One thread per four channels of a pixel; blockIdx.y: index of the image.
__global__ void __launch_bounds__(kThreads)
    pool(const float4* features, int width, int height, int quads, Window window, int out_width,
         int out_height, float4* pooled) {
  const std::size_t n = std::size_t{1} * out_width * out_height * quads;
  const std::size_t k = std::size_t{blockIdx.x} * kThreads + threadIdx.x;
  if (k >= n) return;
  const int quad = static_cast<int>(k % quads);
  const int x = static_cast<int>(k / quads % out_width) * window.stride;
  const int y = static_cast<int>(k / quads / out_width) * window.stride;
  const std::size_t row = std::size_t{1} * width * quads;
  const float4* from = features + blockIdx.y * (row * height) + quad;
  float4 maximum = from[y * row + std::size_t{1} * x * quads];
  for (int v = y; v < min(y + window.size, height); ++v) {
    for (int u = x; u < min(x + window.size, width); ++u)
      maximum = larger(maximum, from[v * row + std::size_t{1} * u * quads]);
  }
  pooled[blockIdx.y * n + k] = maximum;
}

__global__ void __launch_bounds__(kThreads)
    relu_backward(const float4* features, std::size_t n, float4* gradient) {
  const std::size_t k = std::size_t{blockIdx.x} * kThreads + threadIdx.x;
  if (k >= n) return;
  const float4 f = features[k];
  float4 d = gradient[k];
  d.x = f.x > 0.0f ? d.x : 0.0f;
  d.y = f.y > 0.0f ? d.y : 0.0f;
  d.z = f.z > 0.0f ? d.z : 0.0f;
  d.w = f.w > 0.0f ? d.w : 0.0f;
  gradient[k] = d;
}

// Returns whether pixel (x, y), whose feature is f, is the first maximum, in row order, of a window
// that begins at (x0, y0), of channel c.
__device__ bool is_first(const TapBackward& tap, int x0, int y0, int x, int y, int c, float f) {
  for (int v = y0; v <= y; ++v) {
    const int end = v == y ? x : min(x0 + tap.window.size, tap.size.width);
    for (int u = x0; u < end; ++u) {
      if (tap.features[(std::size_t{1} * v * tap.size.width + u) * tap.size.channels + c] == f)
        return false;
    }
  }
  return true;
}

// Returns the gradient that the pooling passes to channel c of pixel (x, y), whose feature is f.
// The gradient of a window goes to its first maximum.
__device__ float pool_backward(const TapBackward& tap, int x, int y, int c, float f) {
  const int stride = tap.window.stride, size = tap.window.size;
  float sum = 0.0f;
  for (int row = y / stride; row >= 0 && row * stride + size > y; --row) {
    if (row >= tap.pooled_size.height) continue;
    for (int column = x / stride; column >= 0 && column * stride + size > x; --column) {
      if (column >= tap.pooled_size.width) continue;
      const std::size_t at =
          (std::size_t{1} * row * tap.pooled_size.width + column) * tap.size.channels + c;
      if (f != tap.pooled[at]) continue;
      if (is_first(tap, column * stride, row * stride, x, y, c, f)) sum += tap.d_output[at];
    }
  }
  return sum;
}

// Returns dL/d(channel c of pixel q, which is (x, y)) by the stages after the tap.
__device__ float later_gradient(const TapBackward& tap, std::size_t q, int x, int y, int c,
                                float f) {
  if (tap.d_output == nullptr) return 0.0f;
  if (tap.pooled != nullptr) return pool_backward(tap, x, y, c, f);
  return tap.d_output[q * tap.size.channels + c];
}

// One warp per pixel.
template <int kChannels>
__global__ void __launch_bounds__(kThreads)
    tap_backward(const TapBackward tap, std::size_t pixels, float inverse_pixels) {
  constexpr int kOwn = kChannels / 32;  // channels per thread: its lane and every 32nd after it
  const int lane = static_cast<int>(threadIdx.x & 31);
  const std::size_t warps = std::size_t{gridDim.x} * kWarps;
  float w[kOwn];
#pragma unroll
  for (int k = 0; k < kOwn; ++k) w[k] = tap.weights[lane + 32 * k];
  float sum_over_pixels = 0.0f;
  for (std::size_t q = std::size_t{blockIdx.x} * kWarps + threadIdx.x / 32; q < pixels;
       q += warps) {
    const float* rendered = tap.features + q * kChannels + lane;
    const float* ground_truth = rendered + pixels * kChannels;
    float a[kOwn], b[kOwn], square_a = 0.0f, square_b = 0.0f;
#pragma unroll
    for (int k = 0; k < kOwn; ++k) {
      a[k] = rendered[32 * k];
      b[k] = ground_truth[32 * k];
      square_a = fmaf(a[k], a[k], square_a);
      square_b = fmaf(b[k], b[k], square_b);
    }
    const float scale_a = 1.0f / sqrtf(warp_sum(square_a) + kSquareEpsilon);
    const float scale_b = 1.0f / sqrtf(warp_sum(square_b) + kSquareEpsilon);
    float sum = 0.0f, along = 0.0f;
#pragma unroll
    for (int k = 0; k < kOwn; ++k) {
      const float difference = a[k] * scale_a - b[k] * scale_b;
      sum = fmaf(w[k] * difference, difference, sum);
      along = fmaf(w[k] * difference, a[k] * scale_a, along);
    }
    sum_over_pixels += sum;
    along = warp_sum(along);
    const float scale = 2.0f * inverse_pixels * scale_a;
    const int x = static_cast<int>(q % tap.size.width), y = static_cast<int>(q / tap.size.width);
    float* gradient = tap.gradient + q * kChannels + lane;
#pragma unroll
    for (int k = 0; k < kOwn; ++k) {
      const float normalised = a[k] * scale_a, difference = normalised - b[k] * scale_b;
      const float own = scale * (w[k] * difference - along * normalised);
      const float later = later_gradient(tap, q, x, y, lane + 32 * k, a[k]);
      gradient[32 * k] = a[k] > 0.0f ? own + later : 0.0f;
    }
  }
  sum_over_pixels = block_sum<kThreads>(sum_over_pixels);
  if (threadIdx.x == 0) tap.sums[blockIdx.x] = sum_over_pixels * inverse_pixels;
}

// One thread per pixel of the input.
__global__ void __launch_bounds__(kThreads)
    strided_backward(const StridedConvolution convolution, std::size_t pixels,
                     const float* d_output, float4* d_input) {
  const std::size_t q = std::size_t{blockIdx.x} * kThreads + threadIdx.x;
  if (q >= pixels) return;
  const int x = static_cast<int>(q % convolution.input.width) + convolution.window.padding;
  const int y = static_cast<int>(q / convolution.input.width) + convolution.window.padding;
  const int stride = convolution.window.stride, size = convolution.window.size;
  const int channels = convolution.output.channels;
  float sum[3] = {};
  for (int row = y / stride; row >= 0 && row * stride + size > y; --row) {
    if (row >= convolution.output.height) continue;
    for (int column = x / stride; column >= 0 && column * stride + size > x; --column) {
      if (column >= convolution.output.width) continue;
      const int tap = (y - row * stride) * size + x - column * stride;
      const float* w = convolution.weights + std::size_t{3} * tap * channels;
      const float* d =
          d_output + (std::size_t{1} * row * convolution.output.width + column) * channels;
      for (int o = 0; o < channels; ++o) {
#pragma unroll
        for (int c = 0; c < 3; ++c) sum[c] = fmaf(w[c * channels + o], d[o], sum[c]);
      }
    }
  }
  d_input[q] = make_float4(sum[0], sum[1], sum[2], 0.0f);
}

__global__ void __launch_bounds__(kThreads)
    add_gradient(const PerceptualStep step, std::size_t pixels, const float4* gradient,
                 float* map_parts) {
  float map[9], by_map[kMapGradients] = {};
#pragma unroll
  for (int k = 0; k < 9; ++k) map[k] = step.colour_map[k];
  for (std::size_t q = std::size_t{blockIdx.x} * kThreads + threadIdx.x; q < pixels;
       q += std::size_t{gridDim.x} * kThreads) {
    const std::size_t at = image_index(step, q);
    const float4 colour = mapped_part(step.background, step.image[at]), d = gradient[q];
    const float g[3] = {step.weight * kInverse[0] * d.x, step.weight * kInverse[1] * d.y,
                        step.weight * kInverse[2] * d.z};
    float4 sum = step.d_image[at];
    sum.x += map[0] * g[0] + map[3] * g[1] + map[6] * g[2];
    sum.y += map[1] * g[0] + map[4] * g[1] + map[7] * g[2];
    sum.z += map[2] * g[0] + map[5] * g[1] + map[8] * g[2];
    step.d_image[at] = sum;
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      by_map[3 * c] = fmaf(g[c], colour.x, by_map[3 * c]);
      by_map[3 * c + 1] = fmaf(g[c], colour.y, by_map[3 * c + 1]);
      by_map[3 * c + 2] = fmaf(g[c], colour.z, by_map[3 * c + 2]);
      by_map[9 + c] = fmaf(g[c], colour.w, by_map[9 + c]);
    }
  }
#pragma unroll
  for (int k = 0; k < kMapGradients; ++k) {
    const float sum = block_sum<kThreads>(by_map[k]);
    if (threadIdx.x == 0) map_parts[k * kPerceptualBlocks + blockIdx.x] = sum;
  }
}

// One warp per quantity: L, then the gradients of the colour map.
__global__ void __launch_bounds__(32 * (kMapGradients + 1))
    totals(const PerceptualStep step, const float* sums, int taps, const float* map_parts,
           int map_blocks, double* value) {
  const int quantity = static_cast<int>(threadIdx.x / 32),
            lane = static_cast<int>(threadIdx.x & 31);
  const float* parts = quantity == 0 ? sums : map_parts + (quantity - 1) * kPerceptualBlocks;
  const int n = quantity == 0 ? taps * kPerceptualBlocks : map_blocks;
  double sum = 0.0;
  for (int k = lane; k < n; k += 32) sum += double{parts[k]};
  sum = warp_sum(sum);
  if (lane != 0) return;
  if (quantity == 0) {
    *value = sum;
  } else {
    step.map_sums[(quantity - 1) * step.map_stride] += static_cast<float>(sum);
  }
}

template <int kChannels>
void start_tap_backward(const TapBackward& tap, cudaStream_t stream) {
  const std::size_t pixels = tap.size.pixels();
  tap_backward<kChannels><<<grid(pixels, kWarps), kThreads, 0, stream>>>(
      tap, pixels, 1.0f / static_cast<float>(pixels));
}

std::size_t pixels_of(const PerceptualStep& step) {
  return std::size_t{1} * step.patch.width * step.patch.height;
}

}  // namespace

void launch_network_input(const PerceptualStep& step, float* input, cudaStream_t stream) {
  const std::size_t pixels = pixels_of(step);
  load_input<<<blocks_of(pixels, kThreads), kThreads, 0, stream>>>(
      step, pixels, reinterpret_cast<float4*>(input));
}

void launch_pool(const float* features, const FeatureSize& size, const Window& window,
                 const FeatureSize& pooled_size, float* pooled, cudaStream_t stream) {
  const int quads = size.channels / 4;
  const std::size_t n = pooled_size.values() / 4;
  pool<<<dim3(blocks_of(n, kThreads), 2), kThreads, 0, stream>>>(
      reinterpret_cast<const float4*>(features), size.width, size.height, quads, window,
      pooled_size.width, pooled_size.height, reinterpret_cast<float4*>(pooled));
}

void launch_relu_backward(const float* features, const FeatureSize& size, float* gradient,
                          cudaStream_t stream) {
  const std::size_t n = size.values() / 4;
  relu_backward<<<blocks_of(n, kThreads), kThreads, 0, stream>>>(
      reinterpret_cast<const float4*>(features), n, reinterpret_cast<float4*>(gradient));
}

void launch_tap_backward(const TapBackward& tap, cudaStream_t stream) {
  cudaMemsetAsync(tap.sums, 0, kPerceptualBlocks * sizeof(float), stream);
  switch (tap.size.channels) {
    case 64:
      return start_tap_backward<64>(tap, stream);
    case 128:
      return start_tap_backward<128>(tap, stream);
    case 192:
      return start_tap_backward<192>(tap, stream);
    case 256:
      return start_tap_backward<256>(tap, stream);
    case 384:
      return start_tap_backward<384>(tap, stream);
    case 512:
      return start_tap_backward<512>(tap, stream);
    default:
      break;  // lpips_networks.cpp allows no other
  }
}

void launch_strided_backward(const StridedConvolution& convolution, const float* d_output,
                             float* d_input, cudaStream_t stream) {
  const std::size_t pixels = convolution.input.pixels();
  strided_backward<<<blocks_of(pixels, kThreads), kThreads, 0, stream>>>(
      convolution, pixels, d_output, reinterpret_cast<float4*>(d_input));
}

void launch_input_gradient(const PerceptualStep& step, const float* gradient, float* map_parts,
                           cudaStream_t stream) {
  const std::size_t pixels = pixels_of(step);
  add_gradient<<<grid(pixels, kThreads), kThreads, 0, stream>>>(
      step, pixels, reinterpret_cast<const float4*>(gradient), map_parts);
}

void launch_totals(const PerceptualStep& step, const float* sums, int taps, const float* map_parts,
                   double* value, cudaStream_t stream) {
  totals<<<1, 32 * (kMapGradients + 1), 0, stream>>>(step, sums, taps, map_parts,
                                                     grid(pixels_of(step), kThreads), value);
}

}  // namespace stgs::encoder::cuda
