// SPDX-License-Identifier: Apache-2.0
// The cuDNN 9 of the machine, loaded at run time so that the program starts without it.
#pragma once

#include <cudnn.h>

#include <utility>

#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// The functions in use. The library remains loaded.
struct Cudnn {
  decltype(&::cudnnGetVersion) get_version;
  decltype(&::cudnnGetErrorString) error_string;
  decltype(&::cudnnCreate) create;
  decltype(&::cudnnDestroy) destroy;
  decltype(&::cudnnSetStream) set_stream;
  decltype(&::cudnnCreateTensorDescriptor) create_tensor;
  decltype(&::cudnnSetTensor4dDescriptor) set_tensor;
  decltype(&::cudnnDestroyTensorDescriptor) destroy_tensor;
  decltype(&::cudnnCreateFilterDescriptor) create_filter;
  decltype(&::cudnnSetFilter4dDescriptor) set_filter;
  decltype(&::cudnnDestroyFilterDescriptor) destroy_filter;
  decltype(&::cudnnCreateConvolutionDescriptor) create_convolution;
  decltype(&::cudnnSetConvolution2dDescriptor) set_convolution;
  decltype(&::cudnnSetConvolutionMathType) set_math_type;
  decltype(&::cudnnDestroyConvolutionDescriptor) destroy_convolution;
  decltype(&::cudnnCreateActivationDescriptor) create_activation;
  decltype(&::cudnnSetActivationDescriptor) set_activation;
  decltype(&::cudnnDestroyActivationDescriptor) destroy_activation;
  decltype(&::cudnnGetConvolutionForwardWorkspaceSize) workspace_size;
  decltype(&::cudnnConvolutionForward) convolve;
  decltype(&::cudnnConvolutionBiasActivationForward) convolve_bias_activation;

  // Loads the library. kUnsupported, with instructions, if there is no cuDNN 9.
  static Result<Cudnn> load();

  // Converts a cuDNN status to kRuntime with cuDNN's text and the operation that failed.
  Status status(cudnnStatus_t status, const char* operation) const;
};

// Owns a cuDNN handle or descriptor.
template <typename T>
class CudnnObject {
 public:
  CudnnObject() = default;
  CudnnObject(CudnnObject&& other) noexcept
      : object_(std::exchange(other.object_, nullptr)), destroy_(other.destroy_) {}
  CudnnObject& operator=(CudnnObject&& other) noexcept {
    std::swap(object_, other.object_);
    std::swap(destroy_, other.destroy_);
    return *this;
  }
  ~CudnnObject() {
    if (object_ != nullptr) destroy_(object_);
  }
  cudnnStatus_t create(cudnnStatus_t (*make)(T*), cudnnStatus_t (*destroy)(T)) {
    destroy_ = destroy;
    return make(&object_);
  }
  operator T() const { return object_; }  // NOLINT: implicit by design

 private:
  T object_ = nullptr;
  cudnnStatus_t (*destroy_)(T) = nullptr;
};

}  // namespace stgs::encoder::cuda
