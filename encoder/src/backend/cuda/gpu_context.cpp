// SPDX-License-Identifier: Apache-2.0
#include "backend/gpu_context.h"

#include <cuda.h>

#include "backend/cuda/memory.h"
#include "backend/cuda/select_gpu.h"

namespace stgs::encoder {
namespace {

constexpr unsigned kSinceVersion = 4000;  // of CUDA, for cuCtxGetCurrent

}  // namespace

Result<GpuContext> gpu_context(int gpu) {
  STGS_ASSIGN(const cudaDeviceProp properties, cuda::select_gpu(gpu));
  GpuContext out;
  out.name = properties.name;
  std::size_t total = 0;
  // Also makes the context of the device current.
  STGS_TRY(cuda::cuda_status(cudaMemGetInfo(&out.free_bytes, &total), "querying the GPU"));
  // The driver is not linked to, so that the program starts without it.
  void* function = nullptr;
  cudaDriverEntryPointQueryResult found{};
  STGS_TRY(
      cuda::cuda_status(cudaGetDriverEntryPointByVersion("cuCtxGetCurrent", &function,
                                                         kSinceVersion, cudaEnableDefault, &found),
                        "querying the GPU"));
  CUcontext context = nullptr;
  if (found != cudaDriverEntryPointSuccess ||
      reinterpret_cast<CUresult (*)(CUcontext*)>(function)(&context) != CUDA_SUCCESS ||
      context == nullptr)
    return unsupported("no usable NVIDIA GPU: its driver has no current context");
  out.context = context;
  return out;
}

}  // namespace stgs::encoder
