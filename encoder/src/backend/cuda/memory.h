// SPDX-License-Identifier: Apache-2.0
// CUDA's memory, streams and errors with owners. One thread; the current device.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <utility>

#include "stgs/format/status.h"

namespace stgs::encoder::cuda {

// kRuntime with CUDA's words and what was being done; ok where there is no error.
Status cuda_status(cudaError_t error, const char* what);

// Bytes as a person reads them.
std::string bytes_text(double bytes);

// kRuntime: so many bytes are not there, and what to do.
Status no_memory_left(std::size_t bytes);

// Device memory for up to capacity() values; what it holds is lost when it grows.
template <typename T>
class DeviceArray {
 public:
  DeviceArray() = default;
  DeviceArray(const DeviceArray&) = delete;
  DeviceArray& operator=(const DeviceArray&) = delete;
  ~DeviceArray() { cudaFree(data_); }

  void release() {
    cudaFree(data_);
    data_ = nullptr;
    capacity_ = 0;
  }
  Status ensure(std::size_t n) {
    if (n <= capacity_) return {};
    release();
    void* memory = nullptr;
    const cudaError_t error = cudaMalloc(&memory, n * sizeof(T));
    if (error != cudaSuccess) {
      (void)cudaGetLastError();
      return no_memory_left(n * sizeof(T));
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

// Host memory that the device copies from and to at full speed, and may write to itself.
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
  // The same memory as the device addresses it.
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
  operator cudaEvent_t() const { return event_; }  // NOLINT: implicit by design

 private:
  cudaEvent_t event_ = nullptr;
};

}  // namespace stgs::encoder::cuda
