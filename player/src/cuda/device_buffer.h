// SPDX-License-Identifier: Apache-2.0
// Owners of CUDA resources: memory, streams, events, graphs. One thread; the current device.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "renderer_memory.h"
#include "stgs/format/status.h"

namespace stgs::player::cuda {

// Converts an error. `action` completes "CUDA failed while ...". Errors: kNoMemory, kDeviceLost,
// else kRuntime.
inline Status cuda_status(cudaError_t error, const char* action) {
  if (error == cudaSuccess) return {};
  std::string message = fmt::format("CUDA failed while {}: {}", action, cudaGetErrorString(error));
  switch (error) {
    case cudaErrorMemoryAllocation:
      return {StatusCode::kNoMemory, std::move(message)};
    // These errors make the CUDA context of the process unusable.
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
              message + ": the GPU has failed; restart the program to use it again"};
    default:
      return {StatusCode::kRuntime, std::move(message)};
  }
}

// Memory that grows on demand, which discards its contents. Charged before it is allocated.
template <cudaError_t (*kAllocate)(void**, std::size_t), cudaError_t (*kFree)(void*)>
class GrowingBuffer {
 public:
  // `memory`, which outlives the buffer, is charged. Null: not limited.
  explicit GrowingBuffer(RendererMemory* memory = nullptr) : memory_(memory) {}
  GrowingBuffer(const GrowingBuffer&) = delete;
  GrowingBuffer& operator=(const GrowingBuffer&) = delete;
  ~GrowingBuffer() { reset(); }

  void reset() {
    kFree(data_);
    data_ = nullptr;
    if (memory_ != nullptr) memory_->release(bytes_);
    bytes_ = 0;
  }
  // Ensures that there are at least `bytes`. kNoMemory if the device is out of memory, kLimit if
  // the memory of the renderer is exceeded; there are none then.
  Status ensure(std::size_t bytes) {
    if (bytes <= bytes_) return {};
    reset();
    std::size_t target = bytes + bytes / 4;
    if (memory_ != nullptr && !memory_->try_charge(target)) {
      target = bytes;
      STGS_TRY(memory_->charge(target));
    }
    if (const cudaError_t error = kAllocate(&data_, target); error != cudaSuccess) {
      (void)cudaGetLastError();  // reported here; clear it
      data_ = nullptr;
      if (memory_ != nullptr) memory_->release(target);
      if (error != cudaErrorMemoryAllocation) return cuda_status(error, "allocating memory");
      return {StatusCode::kNoMemory,
              fmt::format("out of GPU memory (requested {} MiB)", (target >> 20) + 1)};
    }
    bytes_ = target;
    return {};
  }
  std::uint8_t* data() const { return static_cast<std::uint8_t*>(data_); }
  std::size_t bytes() const { return bytes_; }

 private:
  RendererMemory* memory_ = nullptr;
  void* data_ = nullptr;
  std::size_t bytes_ = 0;
};

// Owns a CUDA handle; null until it is created.
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
  // Destroys the handle and returns its address, for a CUDA function that creates one.
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
