// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/cudnn_library.h"

#include <dlfcn.h>

#include <string>

namespace stgs::encoder::cuda {
namespace {

constexpr const char* kLibrary = "libcudnn.so.9";

Status missing(const std::string& why) {
  return unsupported(
      "the perceptual loss on a GPU needs cuDNN 9: {}; install it or add its folder to "
      "LD_LIBRARY_PATH, or leave --perceptual-weights out, or use --backend cpu",
      why);
}

std::string last_error() {
  const char* text = dlerror();
  return text != nullptr ? text : "unknown error";
}

}  // namespace

Result<Cudnn> Cudnn::load() {
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  if (library == nullptr) return missing(last_error());
  const char* absent = nullptr;
  const auto find = [&](auto& function, const char* name) {
    void* address = dlsym(library, name);
    if (address == nullptr) absent = name;
    function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(address);
  };
  Cudnn cudnn{};
  find(cudnn.get_version, "cudnnGetVersion");
  find(cudnn.error_string, "cudnnGetErrorString");
  find(cudnn.create, "cudnnCreate");
  find(cudnn.destroy, "cudnnDestroy");
  find(cudnn.set_stream, "cudnnSetStream");
  find(cudnn.create_tensor, "cudnnCreateTensorDescriptor");
  find(cudnn.set_tensor, "cudnnSetTensor4dDescriptor");
  find(cudnn.destroy_tensor, "cudnnDestroyTensorDescriptor");
  find(cudnn.create_filter, "cudnnCreateFilterDescriptor");
  find(cudnn.set_filter, "cudnnSetFilter4dDescriptor");
  find(cudnn.destroy_filter, "cudnnDestroyFilterDescriptor");
  find(cudnn.create_convolution, "cudnnCreateConvolutionDescriptor");
  find(cudnn.set_convolution, "cudnnSetConvolution2dDescriptor");
  find(cudnn.set_math_type, "cudnnSetConvolutionMathType");
  find(cudnn.destroy_convolution, "cudnnDestroyConvolutionDescriptor");
  find(cudnn.create_activation, "cudnnCreateActivationDescriptor");
  find(cudnn.set_activation, "cudnnSetActivationDescriptor");
  find(cudnn.destroy_activation, "cudnnDestroyActivationDescriptor");
  find(cudnn.workspace_size, "cudnnGetConvolutionForwardWorkspaceSize");
  find(cudnn.convolve, "cudnnConvolutionForward");
  find(cudnn.convolve_bias_activation, "cudnnConvolutionBiasActivationForward");
  if (absent != nullptr) return missing(fmt::format("{} has no {}", kLibrary, absent));
  if (cudnn.get_version() / 10000 != CUDNN_MAJOR)
    return missing(fmt::format("{} calls itself version {}", kLibrary, cudnn.get_version()));
  return cudnn;
}

Status Cudnn::status(cudnnStatus_t status, const char* what) const {
  if (status == CUDNN_STATUS_SUCCESS) return {};
  return runtime_error("cuDNN failed while {}: {}", what, error_string(status));
}

}  // namespace stgs::encoder::cuda
