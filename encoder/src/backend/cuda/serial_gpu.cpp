// SPDX-License-Identifier: Apache-2.0
#include "backend/cuda/serial_gpu.h"

#include "backend/cuda/select_gpu.h"

namespace stgs::encoder::cuda {

Status with_remedy(const Status& status) {
  if (status.ok()) return {};
  return {status.code(), status.message() + "; --backend cpu does without the GPU"};
}

Status SerialGpu::create(int gpu) {
  STGS_ASSIGN(const cudaDeviceProp properties, select_gpu(gpu));
  STGS_TRY(cuda_status(cudaGetDevice(&index_), "choosing the GPU"));
  name_ = fmt::format("cuda ({})", properties.name);
  return stream_.create();
}

}  // namespace stgs::encoder::cuda
