// SPDX-License-Identifier: Apache-2.0
// Memory and streams of a CUDA device.
#pragma once

#include <cuda_runtime_api.h>

#include <atomic>
#include <cstdint>
#include <vector>

#include "catch.h"

namespace stgs::testing {

inline constexpr std::uint8_t kGuard = 0xA5;

inline void require_success(cudaError_t error) {
  INFO(cudaGetErrorString(error));
  REQUIRE(error == cudaSuccess);
}

// A stream that does not synchronise with the default stream.
struct Stream {
  cudaStream_t handle = nullptr;
  Stream() { require_success(cudaStreamCreateWithFlags(&handle, cudaStreamNonBlocking)); }
  ~Stream() { cudaStreamDestroy(handle); }
};

// Device memory filled with kGuard.
struct DeviceMemory {
  std::uint8_t* data = nullptr;
  std::size_t bytes;
  explicit DeviceMemory(std::size_t n) : bytes(n) {
    void* allocated = nullptr;
    require_success(cudaMalloc(&allocated, bytes));
    data = static_cast<std::uint8_t*>(allocated);
    require_success(cudaMemset(data, kGuard, bytes));
    require_success(cudaDeviceSynchronize());
  }
  ~DeviceMemory() { cudaFree(data); }
  std::vector<std::uint8_t> read() const {
    const Stream own;
    std::vector<std::uint8_t> out(bytes);
    require_success(cudaMemcpyAsync(out.data(), data, bytes, cudaMemcpyDeviceToHost, own.handle));
    require_success(cudaStreamSynchronize(own.handle));
    return out;
  }
};

// Blocks a stream until release().
struct Gate {
  std::atomic<bool> is_open = false;
  explicit Gate(cudaStream_t stream) {
    require_success(cudaLaunchHostFunc(
        stream, [](void* self) { static_cast<Gate*>(self)->is_open.wait(false); }, this));
  }
  ~Gate() { release(); }
  void release() {
    is_open = true;
    is_open.notify_all();
  }
};

}  // namespace stgs::testing
