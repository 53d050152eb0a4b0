// SPDX-License-Identifier: Apache-2.0
#include "stgs/encoder/device_image.h"

#include "backend/cuda/memory.h"

namespace stgs::encoder {
namespace {

// Returns the device of the memory.
Result<int> device_of(const void* data) {
  cudaPointerAttributes memory{};
  if (const cudaError_t error = cudaPointerGetAttributes(&memory, data); error != cudaSuccess) {
    (void)cudaGetLastError();
    return unsupported("no usable NVIDIA GPU: {}", cudaGetErrorString(error));
  }
  if (memory.type != cudaMemoryTypeDevice && memory.type != cudaMemoryTypeManaged)
    return usage_error("the memory is not that of a CUDA device");
  return memory.device;
}

}  // namespace

KeptDevice::KeptDevice() {
  if (cudaGetDevice(&device_) == cudaSuccess) return;
  (void)cudaGetLastError();
  device_ = -1;
}

KeptDevice::~KeptDevice() {
  if (device_ >= 0) cudaSetDevice(device_);
}

Status copy_from_device(const DeviceRows& image, std::uint8_t* out) {
  const KeptDevice kept;
  STGS_ASSIGN(const int device, device_of(image.data));
  STGS_TRY(cuda::cuda_status(cudaSetDevice(device), "choosing the GPU of an image"));
  STGS_TRY(cuda::cuda_status(
      cudaMemcpy2DAsync(out, image.row_bytes, image.data, image.stride, image.row_bytes, image.rows,
                        cudaMemcpyDeviceToHost, image.stream),
      "copying an image"));
  return cuda::cuda_status(cudaStreamSynchronize(image.stream), "copying an image");
}

}  // namespace stgs::encoder
