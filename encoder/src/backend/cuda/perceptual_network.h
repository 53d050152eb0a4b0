// SPDX-License-Identifier: Apache-2.0
// The perceptual loss on the GPU: VGG16 by cuDNN, forward for the rendered and the true patch
// together, backward to the rendered one. The same sums as perceptual/perceptual_loss.h.
//
// The weights are fixed, so that the backward of a convolution is a convolution with other weights,
// and one algorithm, which is deterministic, does all of them. Features are channels last.
//
// The true patch's features are made in each step: they are a third of the work, and those of the
// whole pictures, 490 bytes a pixel, would not fit for long (180 GB for 27 cameras and 60 frames of
// 640x360).
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <memory>

#include "backend/cuda/perceptual_kernels.h"
#include "perceptual/vgg16.h"
#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// How the convolutions multiply: with 10 bits of mantissa on the tensor cores (TF32), adding up in
// 32-bit floats; or all in 32-bit floats.
enum class VggPrecision { kTensorCores, kFloat };

// One thread; the current device. Gives the same bits when repeated.
class PerceptualNetwork {
 public:
  virtual ~PerceptualNetwork() = default;
  // Device memory for patches of up to this size.
  virtual Result<std::size_t> bytes(int width, int height) = 0;
  // Takes it, and copies the weights there.
  virtual Status reserve(int width, int height) = 0;
  // Enqueues the loss of a patch that is reserved for, and its gradients.
  virtual Status enqueue(const PerceptualStep& step, cudaStream_t stream) = 0;
  // Where the last step leaves L on the device.
  virtual const double* value() const = 0;
};

// kNotBuilt in a build without cuDNN, kUnsupported where the machine has none.
Status check_perceptual_network();
Result<std::unique_ptr<PerceptualNetwork>> make_perceptual_network(
    std::shared_ptr<const Vgg16> network, VggPrecision precision = VggPrecision::kTensorCores);

}  // namespace stgs::encoder::cuda
