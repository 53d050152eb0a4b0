// SPDX-License-Identifier: Apache-2.0
// The perceptual loss but for its convolutions. Features are channels last; of the pair, the
// rendered picture's come first, then the true one's. Sums are a block's, added up in order.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "perceptual/patch.h"
#include "perceptual/vgg_layers.h"

namespace stgs::encoder::cuda {

inline constexpr int kVggInputs = 4;      // channels of the input: three colours and a zero
inline constexpr int kVggBlocks = 1024;   // of a sum, at most
inline constexpr int kMapGradients = 12;  // of the colour map

// A step's arrays on the device; pictures are `width` pixels wide.
struct PerceptualStep {
  const float4* image = nullptr;               // rendered colours
  const std::uint8_t* ground_truth = nullptr;  // RGB
  const float* colour_map = nullptr;           // 12, from rendered to shown
  int width = 0;
  Patch patch;                // at least kVggMinSize pixels a side
  float weight = 0;           // of the loss in the gradients
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

// The patch of both pictures as the network takes it: 2 x height x width x kVggInputs.
void launch_vgg_input(const PerceptualStep& step, float* input, cudaStream_t stream);

// 2x2 maxima of both pictures' features.
void launch_vgg_pool(const float* features, const FeatureSize& size, float* pooled,
                     cudaStream_t stream);

// gradient = features > 0 ? gradient : 0, for the rendered picture.
void launch_relu_backward(const float* features, const FeatureSize& size, float* gradient,
                          cudaStream_t stream);

// A tap: its share of L, and dL by its features before ReLU.
struct TapBackward {
  FeatureSize size;                 // channels: 64, 128, 256 or 512
  const float* features = nullptr;  // of both pictures
  const float* weights = nullptr;   // of the channels
  // What the pooling after it gave, and the gradient by that, of the rendered picture; null where
  // there is none.
  const float *pooled = nullptr, *d_pooled = nullptr;
  float* gradient = nullptr;  // the rendered picture's, written
  float* sums = nullptr;      // kVggBlocks: shares of L, 0 where there is no block
};
void launch_tap_backward(const TapBackward& tap, cudaStream_t stream);

// From dL by the input to d_picture; map_parts: kMapGradients x kVggBlocks.
void launch_vgg_gradient(const PerceptualStep& step, const float* gradient, float* map_parts,
                         cudaStream_t stream);

// value = L, the sum of all taps' sums; the colour map's gradient into the step's map_sums.
void launch_vgg_totals(const PerceptualStep& step, const float* sums, const float* map_parts,
                       double* value, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
