// SPDX-License-Identifier: Apache-2.0
// The perceptual loss on the GPU, by cuDNN: forward for the rendered and the ground-truth patch
// together, backward for the rendered one. Computes the same sums as
// perceptual/perceptual_loss.h.
//
// The weights are constant, so the backward pass of a convolution with stride 1 is a convolution
// with other weights, and all use the same deterministic algorithm. Features are channels last.
//
// The features of the ground truth are recomputed in every step. They take a third of the time, but
// caching those of complete images, at 490 bytes per pixel of VGG16, would need too much memory
// (180 GB for 27 cameras and 60 frames of 640x360).
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <memory>

#include "backend/cuda/perceptual_kernels.h"
#include "perceptual/feature_network.h"
#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// Arithmetic of the convolutions.
enum class ConvolutionPrecision {
  kTensorCores,  // TF32 products (10 bits of mantissa) on the tensor cores, sums in 32-bit floats
  kFloat,        // 32-bit floats throughout
};

// Call it from one thread; uses the current device. Results are bit-reproducible.
class PerceptualNetwork {
 public:
  virtual ~PerceptualNetwork() = default;
  // Returns the device memory for patches of up to this size, bytes.
  virtual Result<std::size_t> bytes(int width, int height) = 0;
  // Allocates that memory and uploads the weights.
  virtual Status reserve(int width, int height) = 0;
  // Enqueues the loss of a patch within the reserved size, and its gradients.
  virtual Status enqueue(const PerceptualStep& step, cudaStream_t stream) = 0;
  // Returns the device address of L of the latest step.
  virtual const double* value() const = 0;
};

// Checks for cuDNN. kNotBuilt in a build without it, kUnsupported if the machine has none.
Status check_perceptual_network();
// Creates the network. Errors as above.
Result<std::unique_ptr<PerceptualNetwork>> make_perceptual_network(
    std::shared_ptr<const FeatureNetwork> network,
    ConvolutionPrecision precision = ConvolutionPrecision::kTensorCores);

}  // namespace stgs::encoder::cuda
