// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/memory.h"

namespace stgs::encoder::cuda {

Status cuda_status(cudaError_t error, const char* what) {
  if (error == cudaSuccess) return {};
  return runtime_error("CUDA failed while {}: {}", what, cudaGetErrorString(error));
}

std::string bytes_text(double bytes) {
  constexpr double kGiB = 1 << 30, kMiB = 1 << 20;
  return bytes >= kGiB ? fmt::format("{:.1f} GiB", bytes / kGiB)
                       : fmt::format("{:.1f} MiB", bytes / kMiB);
}

Status no_memory_left(std::size_t bytes) {
  return runtime_error(
      "the GPU has no {} left for training: free some, or use fewer primitives or smaller frames",
      bytes_text(static_cast<double>(bytes)));
}

}  // namespace stgs::encoder::cuda
