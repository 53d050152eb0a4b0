// SPDX-License-Identifier: Apache-2.0
// Kernels of the perceptual loss, except its convolutions. Features are channels last, those of the
// rendered image before those of the ground truth. Each block writes its sums, which are added in
// order.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "backend/cuda/kernels.h"
#include "perceptual/patch.h"
#include "perceptual/vgg_layers.h"

namespace stgs::encoder::cuda {

inline constexpr int kVggInputs = 4;      // channels of the input: three colours and a zero
inline constexpr int kVggBlocks = 1024;   // maximum blocks of a sum
inline constexpr int kMapGradients = 12;  // of the colour map

// A step's arrays on the device; images are `width` pixels wide.
struct PerceptualStep {
  const float4* image = nullptr;               // rendered colours
  const std::uint8_t* ground_truth = nullptr;  // RGB
  const float* colour_map = nullptr;           // 12 floats, from rendered to corrected colour
  Background background;
  int width = 0;
  Patch patch;                // at least kVggMinSize pixels per side
  float weight = 0;           // of the loss, applied to the gradients
  float4* d_image = nullptr;  // x, y, z: weight dL/dcolour is added to them
  // weight dL/d(entry k of the colour map) is added to map_sums[k * map_stride].
  float* map_sums = nullptr;
  std::size_t map_stride = 1;
};

struct FeatureSize {
  int width = 0, height = 0, channels = 0;
  std::size_t pixels() const { return std::size_t{1} * width * height; }
  std::size_t values() const { return pixels() * static_cast<std::size_t>(channels); }
};

// Loads the patch of both images as network input: 2 x height x width x kVggInputs.
void launch_vgg_input(const PerceptualStep& step, float* input, cudaStream_t stream);

// Applies 2x2 max pooling to both images' features.
void launch_vgg_pool(const float* features, const FeatureSize& size, float* pooled,
                     cudaStream_t stream);

// Computes gradient = features > 0 ? gradient : 0, for the rendered image.
void launch_relu_backward(const float* features, const FeatureSize& size, float* gradient,
                          cudaStream_t stream);

// Arguments of a tap: its contribution to L, and dL/d(features before ReLU).
struct TapBackward {
  FeatureSize size;                 // channels: 64, 128, 256 or 512
  const float* features = nullptr;  // of both images
  const float* weights = nullptr;   // of the channels
  // Output of the pooling after the tap and its gradient, for the rendered image; null if none.
  const float *pooled = nullptr, *d_pooled = nullptr;
  float* gradient = nullptr;  // output, for the rendered image
  float* sums = nullptr;      // kVggBlocks: contributions to L; 0 for unused blocks
};
void launch_tap_backward(const TapBackward& tap, cudaStream_t stream);

// Adds dL/d(input) to d_image and writes map_parts (kMapGradients x kVggBlocks).
void launch_vgg_gradient(const PerceptualStep& step, const float* gradient, float* map_parts,
                         cudaStream_t stream);

// Computes value = L, the sum of all taps' sums, and adds the colour map's gradient to map_sums.
void launch_vgg_totals(const PerceptualStep& step, const float* sums, const float* map_parts,
                       double* value, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
