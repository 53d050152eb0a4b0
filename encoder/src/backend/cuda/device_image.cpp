// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/device_image.h"

#include "backend/cuda/memory.h"

namespace stgs::encoder {
namespace {

Status check_memory(const void* data) {
  int current = 0;
  if (const cudaError_t error = cudaGetDevice(&current); error != cudaSuccess) {
    (void)cudaGetLastError();
    return unsupported("no usable NVIDIA GPU: {}", cudaGetErrorString(error));
  }
  cudaPointerAttributes memory{};
  if (const cudaError_t error = cudaPointerGetAttributes(&memory, data); error != cudaSuccess) {
    (void)cudaGetLastError();
    return unsupported("no usable NVIDIA GPU: {}", cudaGetErrorString(error));
  }
  if (memory.type != cudaMemoryTypeDevice && memory.type != cudaMemoryTypeManaged)
    return usage_error("the memory is not that of a CUDA device");
  if (memory.device != current) {
    return usage_error("the memory belongs to CUDA device {}, but device {} is current",
                       memory.device, current);
  }
  return {};
}

}  // namespace

Status copy_from_device(const DeviceRows& image, std::uint8_t* out) {
  STGS_TRY(check_memory(image.data));
  STGS_TRY(cuda::cuda_status(
      cudaMemcpy2DAsync(out, image.row_bytes, image.data, image.stride, image.row_bytes, image.rows,
                        cudaMemcpyDeviceToHost, image.stream),
      "copying an image"));
  return cuda::cuda_status(cudaStreamSynchronize(image.stream), "copying an image");
}

}  // namespace stgs::encoder
