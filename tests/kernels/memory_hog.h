// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <vector>

namespace stgs::testing {

// Allocates the free memory of the device, in blocks of at least 1 MiB, except `left` bytes.
class MemoryHog {
 public:
  explicit MemoryHog(std::size_t left = 0) {
    void* spared = nullptr;
    if (left > 0 && cudaMalloc(&spared, left) != cudaSuccess) spared = nullptr;
    for (std::size_t bytes = std::size_t{1} << 34; bytes >= std::size_t{1} << 20; bytes /= 2) {
      for (void* block = nullptr; cudaMalloc(&block, bytes) == cudaSuccess;) {
        blocks_.push_back(block);
      }
    }
    (void)cudaGetLastError();
    cudaFree(spared);
  }
  MemoryHog(const MemoryHog&) = delete;
  MemoryHog& operator=(const MemoryHog&) = delete;
  ~MemoryHog() {
    for (void* block : blocks_) cudaFree(block);
  }

 private:
  std::vector<void*> blocks_;
};

}  // namespace stgs::testing
