// SPDX-License-Identifier: Apache-2.0
// What CUDA gives, with an owner: memory, a stream, events, a graph. One thread; the current
// device.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "stgs/format/status.h"

namespace stgs::player::cuda {

inline Status cuda_status(cudaError_t error, const char* what) {
  if (error == cudaSuccess) return {};
  std::string message = fmt::format("CUDA failed while {}: {}", what, cudaGetErrorString(error));
  switch (error) {
    case cudaErrorMemoryAllocation:
      return {StatusCode::kNoMemory, std::move(message)};
    // After these the process's context answers nothing else.
    case cudaErrorAssert:
    case cudaErrorECCUncorrectable:
    case cudaErrorHardwareStackError:
    case cudaErrorIllegalAddress:
    case cudaErrorIllegalInstruction:
    case cudaErrorInvalidAddressSpace:
    case cudaErrorInvalidPc:
    case cudaErrorLaunchFailure:
    case cudaErrorLaunchTimeout:
    case cudaErrorMisalignedAddress:
    case cudaErrorNvlinkUncorrectable:
      return {StatusCode::kDeviceLost,
              message + ": the GPU has failed, and this process can use it no more"};
    default:
      return {StatusCode::kRuntime, std::move(message)};
  }
}

// Bytes that grow as they are asked for; what they held is lost then.
template <cudaError_t (*kAllocate)(void**, std::size_t), cudaError_t (*kFree)(void*)>
class GrowingBuffer {
 public:
  GrowingBuffer() = default;
  GrowingBuffer(const GrowingBuffer&) = delete;
  GrowingBuffer& operator=(const GrowingBuffer&) = delete;
  ~GrowingBuffer() { kFree(data_); }

  void reset() {
    kFree(data_);
    data_ = nullptr;
    bytes_ = 0;
  }
  Status ensure(std::size_t bytes) {
    if (bytes <= bytes_) return {};
    reset();
    const std::size_t wanted = bytes + bytes / 4;
    if (const cudaError_t error = kAllocate(&data_, wanted); error != cudaSuccess) {
      (void)cudaGetLastError();  // told here, and remembered no longer
      data_ = nullptr;
      if (error != cudaErrorMemoryAllocation) return cuda_status(error, "taking memory");
      return {StatusCode::kNoMemory,
              fmt::format("no {} MiB of GPU memory left", (wanted >> 20) + 1)};
    }
    bytes_ = wanted;
    return {};
  }
  std::uint8_t* data() const { return static_cast<std::uint8_t*>(data_); }
  std::size_t bytes() const { return bytes_; }

 private:
  void* data_ = nullptr;
  std::size_t bytes_ = 0;
};

// A handle of CUDA's; `get` is null until it is created.
template <typename Handle, cudaError_t (*kDestroy)(Handle)>
class Owned {
 public:
  Owned() = default;
  Owned(const Owned&) = delete;
  Owned& operator=(const Owned&) = delete;
  ~Owned() { reset(); }

  void reset() {
    if (handle_ != nullptr) kDestroy(handle_);
    handle_ = nullptr;
  }
  // Where a function of CUDA's puts a new one.
  Handle* fresh() {
    reset();
    return &handle_;
  }
  Handle get() const { return handle_; }

 private:
  Handle handle_ = nullptr;
};

using Stream = Owned<cudaStream_t, cudaStreamDestroy>;
using Event = Owned<cudaEvent_t, cudaEventDestroy>;
using Graph = Owned<cudaGraph_t, cudaGraphDestroy>;
using GraphExec = Owned<cudaGraphExec_t, cudaGraphExecDestroy>;
using MemoryPool = Owned<cudaMemPool_t, cudaMemPoolDestroy>;

using DeviceBuffer = GrowingBuffer<cudaMalloc, cudaFree>;
using PinnedBuffer = GrowingBuffer<cudaMallocHost, cudaFreeHost>;

}  // namespace stgs::player::cuda
