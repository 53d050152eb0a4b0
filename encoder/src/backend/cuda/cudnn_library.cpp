// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/cudnn_library.h"

#include <string>

#include "backend/cuda/shared_library.h"

namespace stgs::encoder::cuda {
namespace {

constexpr const char* kLibrary = "libcudnn.so.9";

Status missing(const std::string& reason) {
  return unsupported(
      "the perceptual loss on a GPU requires cuDNN 9: {}; install it, add its folder to "
      "LD_LIBRARY_PATH, omit --perceptual-weights or use --backend cpu",
      reason);
}

}  // namespace

Result<Cudnn> Cudnn::load() {
  SharedLibrary library(kLibrary);
  Cudnn cudnn{};
  library.find(cudnn.get_version, "cudnnGetVersion");
  library.find(cudnn.error_string, "cudnnGetErrorString");
  library.find(cudnn.create, "cudnnCreate");
  library.find(cudnn.destroy, "cudnnDestroy");
  library.find(cudnn.set_stream, "cudnnSetStream");
  library.find(cudnn.create_tensor, "cudnnCreateTensorDescriptor");
  library.find(cudnn.set_tensor, "cudnnSetTensor4dDescriptor");
  library.find(cudnn.destroy_tensor, "cudnnDestroyTensorDescriptor");
  library.find(cudnn.create_filter, "cudnnCreateFilterDescriptor");
  library.find(cudnn.set_filter, "cudnnSetFilter4dDescriptor");
  library.find(cudnn.destroy_filter, "cudnnDestroyFilterDescriptor");
  library.find(cudnn.create_convolution, "cudnnCreateConvolutionDescriptor");
  library.find(cudnn.set_convolution, "cudnnSetConvolution2dDescriptor");
  library.find(cudnn.set_math_type, "cudnnSetConvolutionMathType");
  library.find(cudnn.destroy_convolution, "cudnnDestroyConvolutionDescriptor");
  library.find(cudnn.create_activation, "cudnnCreateActivationDescriptor");
  library.find(cudnn.set_activation, "cudnnSetActivationDescriptor");
  library.find(cudnn.destroy_activation, "cudnnDestroyActivationDescriptor");
  library.find(cudnn.workspace_size, "cudnnGetConvolutionForwardWorkspaceSize");
  library.find(cudnn.convolve, "cudnnConvolutionForward");
  library.find(cudnn.convolve_bias_activation, "cudnnConvolutionBiasActivationForward");
  if (!library.problem().empty()) return missing(library.problem());
  if (cudnn.get_version() / 10000 != CUDNN_MAJOR)
    return missing(fmt::format("{} reports version {}", kLibrary, cudnn.get_version()));
  return cudnn;
}

Status Cudnn::status(cudnnStatus_t status, const char* operation) const {
  if (status == CUDNN_STATUS_SUCCESS) return {};
  return runtime_error("cuDNN failed while {}: {}", operation, error_string(status));
}

}  // namespace stgs::encoder::cuda
