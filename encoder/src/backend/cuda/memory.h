// SPDX-License-Identifier: Apache-2.0
// RAII wrappers of CUDA memory, streams and events, and error handling. All act on the current
// device, from one thread.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <utility>

#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// Converts a CUDA error to kRuntime with CUDA's text and the operation that failed.
Status cuda_status(cudaError_t error, const char* operation);

// Formats a size for humans, in MiB or GiB.
std::string bytes_text(double bytes);

// Returns kRuntime for a failed allocation of `bytes`, with a remedy.
Status out_of_memory(std::size_t bytes);

// Device memory for up to capacity() values; growing discards the contents.
template <typename T>
class DeviceArray {
 public:
  DeviceArray() = default;
  DeviceArray(const DeviceArray&) = delete;
  DeviceArray& operator=(const DeviceArray&) = delete;
  ~DeviceArray() { cudaFree(data_); }

  // Frees the memory.
  void release() {
    cudaFree(data_);
    data_ = nullptr;
    capacity_ = 0;
  }
  // Grows the capacity to at least n values.
  Status ensure(std::size_t n) {
    if (n <= capacity_) return {};
    release();
    void* memory = nullptr;
    const cudaError_t error = cudaMalloc(&memory, n * sizeof(T));
    if (error != cudaSuccess) {
      (void)cudaGetLastError();
      return out_of_memory(n * sizeof(T));
    }
    data_ = static_cast<T*>(memory);
    capacity_ = n;
    return {};
  }
  T* data() const { return data_; }
  std::size_t capacity() const { return capacity_; }

 private:
  T* data_ = nullptr;
  std::size_t capacity_ = 0;
};

// Page-locked host memory, mapped into device address space, for transfers at full speed. Growing
// discards the contents.
template <typename T>
class PinnedArray {
 public:
  PinnedArray() = default;
  PinnedArray(const PinnedArray&) = delete;
  PinnedArray& operator=(const PinnedArray&) = delete;
  ~PinnedArray() { cudaFreeHost(data_); }

  Status ensure(std::size_t n) {
    if (n <= capacity_) return {};
    cudaFreeHost(data_);
    data_ = nullptr;
    capacity_ = 0;
    void* memory = nullptr;
    STGS_TRY(cuda_status(cudaHostAlloc(&memory, n * sizeof(T), cudaHostAllocMapped),
                         "allocating pinned memory"));
    data_ = static_cast<T*>(memory);
    capacity_ = n;
    return {};
  }
  T* data() const { return data_; }
  // Returns the device address of the memory; null on error.
  T* on_device() const {
    void* pointer = nullptr;
    return cudaHostGetDevicePointer(&pointer, data_, 0) == cudaSuccess ? static_cast<T*>(pointer)
                                                                       : nullptr;
  }

 private:
  T* data_ = nullptr;
  std::size_t capacity_ = 0;
};

class Stream {
 public:
  Stream() = default;
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  ~Stream() {
    if (stream_ != nullptr) cudaStreamDestroy(stream_);
  }
  Status create() {
    if (stream_ != nullptr) return {};
    return cuda_status(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking),
                       "creating a stream");
  }
  Status wait() const { return cuda_status(cudaStreamSynchronize(stream_), "waiting for the GPU"); }
  operator cudaStream_t() const { return stream_; }  // NOLINT: implicit by design

 private:
  cudaStream_t stream_ = nullptr;
};

class Event {
 public:
  Event() = default;
  Event(const Event&) = delete;
  Event& operator=(const Event&) = delete;
  Event(Event&& other) noexcept : event_(std::exchange(other.event_, nullptr)) {}
  ~Event() {
    if (event_ != nullptr) cudaEventDestroy(event_);
  }
  Status create() {
    if (event_ != nullptr) return {};
    return cuda_status(cudaEventCreateWithFlags(&event_, cudaEventDisableTiming),
                       "creating an event");
  }
  // For wait().
  Status create_blocking() {
    if (event_ != nullptr) return {};
    return cuda_status(
        cudaEventCreateWithFlags(&event_, cudaEventDisableTiming | cudaEventBlockingSync),
        "creating an event");
  }
  // Waits without use of a core.
  Status wait() const { return cuda_status(cudaEventSynchronize(event_), "waiting for the GPU"); }
  operator cudaEvent_t() const { return event_; }  // NOLINT: implicit by design

 private:
  cudaEvent_t event_ = nullptr;
};

}  // namespace stgs::encoder::cuda
