// SPDX-License-Identifier: Apache-2.0
// Kernels of the perceptual loss, except its convolutions. Features are channels last, those of the
// rendered image before those of the ground truth. Each block writes its sums, which are added in
// order.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "backend/cuda/kernels.h"
#include "perceptual/convolution.h"
#include "perceptual/patch.h"

namespace stgs::encoder::cuda {

inline constexpr int kNetworkInputs = 4;        // channels: three colours and a zero
inline constexpr int kPerceptualBlocks = 1024;  // maximum blocks of a sum
inline constexpr int kMapGradients = 12;        // of the colour map

// A step's arrays on the device; images are `width` pixels wide.
struct PerceptualStep {
  const float4* image = nullptr;               // rendered colours
  const std::uint8_t* ground_truth = nullptr;  // RGB
  const float* colour_map = nullptr;           // 12 floats, from rendered to corrected colour
  Background background;
  int width = 0;
  Patch patch;                // that the network accepts
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

// Loads the patch of both images as network input: 2 x height x width x kNetworkInputs.
void launch_network_input(const PerceptualStep& step, float* input, cudaStream_t stream);

// Applies max pooling to both images' features.
void launch_pool(const float* features, const FeatureSize& size, const Window& window,
                 const FeatureSize& pooled_size, float* pooled, cudaStream_t stream);

// Computes gradient = features > 0 ? gradient : 0, for the rendered image.
void launch_relu_backward(const float* features, const FeatureSize& size, float* gradient,
                          cudaStream_t stream);

// Arguments of a tap: its contribution to L, and dL/d(features before ReLU).
struct TapBackward {
  FeatureSize size;                 // channels: 64, 128, 192, 256, 384 or 512
  const float* features = nullptr;  // of both images
  const float* weights = nullptr;   // of the channels
  // dL/d(features) by the stages after the tap, or, if a pooling follows, dL/d(its output); null
  // for the last tap. For the rendered image.
  const float* d_output = nullptr;
  // The pooling after the tap and its output for the rendered image; null: none.
  Window window;
  FeatureSize pooled_size;
  const float* pooled = nullptr;
  float* gradient = nullptr;  // output, for the rendered image
  float* sums = nullptr;      // kPerceptualBlocks: contributions to L; 0 for unused blocks
};
void launch_tap_backward(const TapBackward& tap, cudaStream_t stream);

// A convolution with a stride whose input has three channels and a zero.
struct StridedConvolution {
  FeatureSize output, input;
  Window window;
  const float* weights = nullptr;  // taps x 3 x output channels
};
// Computes dL/d(its input) from dL/d(its output), for one image.
void launch_strided_backward(const StridedConvolution& convolution, const float* d_output,
                             float* d_input, cudaStream_t stream);

// Adds dL/d(input) to d_image and writes map_parts (kMapGradients x kPerceptualBlocks).
void launch_input_gradient(const PerceptualStep& step, const float* gradient, float* map_parts,
                           cudaStream_t stream);

// Computes value = L, the sum of the sums of `taps` taps, and adds the colour map's gradient to
// map_sums.
void launch_totals(const PerceptualStep& step, const float* sums, int taps, const float* map_parts,
                   double* value, cudaStream_t stream);

}  // namespace stgs::encoder::cuda
