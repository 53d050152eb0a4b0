// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/kernels.h"

namespace stgs::encoder::cuda {
namespace {

__global__ void nothing() {}

}  // namespace

cudaError_t kernels_loadable() {
  cudaFuncAttributes attributes{};
  return cudaFuncGetAttributes(&attributes, nothing);
}

}  // namespace stgs::encoder::cuda
