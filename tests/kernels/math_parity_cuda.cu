// SPDX-License-Identifier: Apache-2.0
#include <cuda_runtime.h>

#include "math_parity_cuda.h"

namespace stgs::test {
namespace {

__global__ void evaluate(const math::ParityInput* inputs, math::ParityResult* results, int count) {
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i < count) results[i] = math::evaluate_parity(inputs[i]);
}

}  // namespace

std::string cuda_unavailable_reason() {
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess) return cudaGetErrorString(error);
  return count > 0 ? "" : "no CUDA device";
}

std::string evaluate_on_cuda(const std::vector<math::ParityInput>& inputs,
                             std::vector<math::ParityResult>* results) {
  const int count = static_cast<int>(inputs.size());
  const std::size_t in_bytes = inputs.size() * sizeof(math::ParityInput);
  const std::size_t out_bytes = inputs.size() * sizeof(math::ParityResult);
  results->resize(inputs.size());
  void* in = nullptr;
  void* out = nullptr;
  cudaError_t error = cudaMalloc(&in, in_bytes);
  if (error == cudaSuccess) error = cudaMalloc(&out, out_bytes);
  if (error == cudaSuccess) error = cudaMemcpy(in, inputs.data(), in_bytes, cudaMemcpyHostToDevice);
  if (error == cudaSuccess) {
    const int block = 128;
    evaluate<<<(count + block - 1) / block, block>>>(static_cast<const math::ParityInput*>(in),
                                                     static_cast<math::ParityResult*>(out), count);
    error = cudaGetLastError();
  }
  // Waits for the kernel, so it also reports a failure of the kernel.
  if (error == cudaSuccess)
    error = cudaMemcpy(results->data(), out, out_bytes, cudaMemcpyDeviceToHost);
  cudaFree(in);
  cudaFree(out);
  return error == cudaSuccess ? "" : cudaGetErrorString(error);
}

}  // namespace stgs::test
