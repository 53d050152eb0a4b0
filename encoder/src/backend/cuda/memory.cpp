// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/memory.h"

namespace stgs::encoder::cuda {

Status cuda_status(cudaError_t error, const char* operation) {
  if (error == cudaSuccess) return {};
  return runtime_error("CUDA failed while {}: {}", operation, cudaGetErrorString(error));
}

std::string bytes_text(double bytes) {
  constexpr double kGiB = 1 << 30, kMiB = 1 << 20;
  return bytes >= kGiB ? fmt::format("{:.1f} GiB", bytes / kGiB)
                       : fmt::format("{:.1f} MiB", bytes / kMiB);
}

Status out_of_memory(std::size_t bytes) {
  return runtime_error(
      "out of GPU memory (allocating {}); free some, or use fewer primitives or smaller frames",
      bytes_text(static_cast<double>(bytes)));
}

}  // namespace stgs::encoder::cuda
