// SPDX-License-Identifier: Apache-2.0
// A convolution by cuDNN, channels last.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend/cuda/cudnn_library.h"
#include "backend/cuda/memory.h"
#include "backend/cuda/perceptual_kernels.h"
#include "perceptual/feature_network.h"

namespace stgs::encoder::cuda {

// Copies weights to the device.
Status upload_weights(const std::vector<float>& values, DeviceArray<float>& array);

// Working memory of cuDNN.
struct CudnnWorkspace {
  std::uint8_t* data = nullptr;
  std::size_t bytes = 0;
};

class CudnnConvolution {
 public:
  // A convolution of `in` channels in memory, at least stage.in; the others have no effect.
  Status create_forward(const Cudnn& cudnn, const FeatureStage& stage, int in,
                        cudnnMathType_t math);
  // The backward pass of that, for a stage with stride 1: from dL/doutput to dL/dinput.
  Status create_backward(const Cudnn& cudnn, const FeatureStage& stage, int in,
                         cudnnMathType_t math);
  // Sets the sizes of the input and the output of apply().
  Status set_size(int images, const FeatureSize& input, const FeatureSize& output);
  // Returns the working memory of apply() for these sizes.
  Result<std::size_t> workspace_bytes(cudnnHandle_t handle) const;
  // Returns the device memory of the weights.
  std::size_t weight_bytes() const { return (weight_count_ + bias_count_) * sizeof(float); }
  // Moves the weights to the device. Once, unless it fails.
  Status upload();
  // Enqueues the convolution, with bias and ReLU if it is forward.
  Status apply(cudnnHandle_t handle, cudnnActivationDescriptor_t relu, const float* input,
               const CudnnWorkspace& workspace, float* output) const;

 private:
  Status describe(const Cudnn& cudnn, const Window& window, int in, int out, cudnnMathType_t math);

  const Cudnn* cudnn_ = nullptr;
  CudnnObject<cudnnTensorDescriptor_t> input_, output_, bias_shape_;
  CudnnObject<cudnnFilterDescriptor_t> filter_;
  CudnnObject<cudnnConvolutionDescriptor_t> convolution_;
  std::vector<float> weight_, bias_;  // until upload(); weight_: out x size x size x in
  std::size_t weight_count_ = 0, bias_count_ = 0;  // bias_count_: 0 if backward
  DeviceArray<float> device_weight_, device_bias_;
};

}  // namespace stgs::encoder::cuda
