// SPDX-License-Identifier: Apache-2.0
#include <cuda_runtime.h>

#include "math_parity_cuda.h"

namespace stgs::test {
namespace {

__global__ void evaluate(const math::ParityGiven* given, math::ParityFound* found, int count) {
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i < count) found[i] = math::parity_of(given[i]);
}

}  // namespace

std::string cuda_missing() {
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess) return cudaGetErrorString(error);
  return count > 0 ? "" : "no CUDA device";
}

std::string parity_on_cuda(const std::vector<math::ParityGiven>& given,
                           std::vector<math::ParityFound>* found) {
  const int count = static_cast<int>(given.size());
  const std::size_t in_bytes = given.size() * sizeof(math::ParityGiven);
  const std::size_t out_bytes = given.size() * sizeof(math::ParityFound);
  found->resize(given.size());
  void* in = nullptr;
  void* out = nullptr;
  cudaError_t error = cudaMalloc(&in, in_bytes);
  if (error == cudaSuccess) error = cudaMalloc(&out, out_bytes);
  if (error == cudaSuccess) error = cudaMemcpy(in, given.data(), in_bytes, cudaMemcpyHostToDevice);
  if (error == cudaSuccess) {
    const int block = 128;
    evaluate<<<(count + block - 1) / block, block>>>(static_cast<const math::ParityGiven*>(in),
                                                     static_cast<math::ParityFound*>(out), count);
    error = cudaGetLastError();
  }
  // Waits for the kernel, and so reports its failure too.
  if (error == cudaSuccess)
    error = cudaMemcpy(found->data(), out, out_bytes, cudaMemcpyDeviceToHost);
  cudaFree(in);
  cudaFree(out);
  return error == cudaSuccess ? "" : cudaGetErrorString(error);
}

}  // namespace stgs::test
