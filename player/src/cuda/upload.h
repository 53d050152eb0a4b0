// SPDX-License-Identifier: Apache-2.0
// Pinned host memory that is filled with arrays and uploaded at once.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "stgs/format/parallel.h"

namespace stgs::player::cuda {

inline constexpr std::size_t kArrayAlign = 16;

constexpr std::size_t aligned(std::size_t bytes) {
  return (bytes + kArrayAlign - 1) / kArrayAlign * kArrayAlign;
}

// Host memory with a device copy of the same layout. One thread at a time.
class Upload {
 public:
  Upload(std::uint8_t* host, std::uint8_t* device) : host_(host), device_(device) {}

  // Appends a copy of `values`. Returns its device address. A large array is not copied before
  // copy_large(), and must exist unchanged until then.
  template <typename T>
  T* add(const std::vector<T>& values) {
    const std::size_t at = used_, bytes = sizeof(T) * values.size();
    const auto* const from = reinterpret_cast<const std::uint8_t*>(values.data());
    if (bytes > kChunk) {
      for (std::size_t k = 0; k < bytes; k += kChunk)
        large_.push_back({host_ + at + k, from + k, std::min(kChunk, bytes - k)});
    } else if (bytes > 0) {
      std::memcpy(host_ + at, from, bytes);
    }
    used_ += aligned(bytes);
    return reinterpret_cast<T*>(device_ + at);
  }
  // Copies the large arrays, on several threads: one cannot use the bandwidth of the memory.
  void copy_large() {
    parallel_for(std::size_t{0}, large_.size(), [this](std::size_t i) {
      std::memcpy(large_[i].to, large_[i].from, large_[i].bytes);
    });
    large_.clear();
  }
  std::size_t used() const { return used_; }

 private:
  static constexpr std::size_t kChunk = 256 << 10;
  struct Copy {
    std::uint8_t* to;
    const std::uint8_t* from;
    std::size_t bytes;
  };

  std::uint8_t *host_, *device_;
  std::size_t used_ = 0;
  std::vector<Copy> large_;
};

}  // namespace stgs::player::cuda
