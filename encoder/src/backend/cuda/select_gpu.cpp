// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/select_gpu.h"

#include "backend/cuda/kernels.h"
#include "backend/cuda/memory.h"

namespace stgs::encoder::cuda {
namespace {

Status no_device(const char* reason) {
  return unsupported("no usable NVIDIA GPU: {}", reason);
}

}  // namespace

Result<cudaDeviceProp> select_gpu(int gpu) {
  int count = 0;
  if (const cudaError_t error = cudaGetDeviceCount(&count); error != cudaSuccess) {
    // The runtime reports the same error for a missing driver and for one that is too old.
    if (error == cudaErrorInsufficientDriver) return no_device("NVIDIA driver missing or too old");
    return no_device(cudaGetErrorString(error));
  }
  if (count == 0) return no_device("no device found");
  cudaDeviceProp properties{};
  const int device = gpu % count;
  STGS_TRY(cuda_status(cudaSetDevice(device), "choosing the GPU"));
  STGS_TRY(cuda_status(cudaGetDeviceProperties(&properties, device), "querying the GPU"));
  if (const cudaError_t error = kernels_loadable(); error != cudaSuccess) {
    (void)cudaGetLastError();
    return unsupported(
        "this build has no code for the {} (compute capability {}.{}); rebuild with "
        "-DCMAKE_CUDA_ARCHITECTURES={}{}",
        properties.name, properties.major, properties.minor, properties.major, properties.minor);
  }
  return properties;
}

}  // namespace stgs::encoder::cuda
