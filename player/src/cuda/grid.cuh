// SPDX-License-Identifier: Apache-2.0
// Sizes of grids whose thread blocks take work by tickets.
#pragma once

#include <cuda_runtime.h>

namespace stgs::player::cuda {

// Computes the thread blocks of a kernel that are resident on the current GPU at once. Fails if the
// kernel cannot be loaded.
template <typename Kernel>
cudaError_t resident_blocks(Kernel kernel, int threads, unsigned& blocks) {
  int device = 0, processors = 0, each = 0;
  cudaError_t error = cudaGetDevice(&device);
  if (error == cudaSuccess) {
    error = cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device);
  }
  if (error == cudaSuccess) {
    error = cudaOccupancyMaxActiveBlocksPerMultiprocessor(&each, kernel, threads, 0);
  }
  blocks = static_cast<unsigned>(processors * each);
  return error;
}

// Defined next to their kernels.
cudaError_t select_grid(unsigned& blocks);
cudaError_t project_grids(int sh_degree, unsigned& one, unsigned& several);
cudaError_t list_grids(unsigned& plain, unsigned& fovea);
cudaError_t sort_grids(unsigned& depth, unsigned& tile, unsigned& ranges);

}  // namespace stgs::player::cuda
