// SPDX-License-Identifier: Apache-2.0
// Pinned memory through which the host sends what it has in pageable memory: it fills one part
// while the device still reads the other.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/device_buffer.h"

namespace stgs::player::cuda {

// One thread; the current device.
class HostStaging {
 public:
  // Makes each part as large, at least.
  Status ensure(std::size_t bytes);
  // The part that is to be filled, once the device has done with it.
  Result<std::uint8_t*> next();
  // Starts copying the beginning of that part, in the stream's order.
  Status upload(void* to, std::size_t bytes, cudaStream_t stream);

 private:
  struct Part {
    PinnedBuffer memory;
    Event sent;  // the last copy out of it
  };
  Part parts_[2];
  int filled_ = 0;  // the part that next() gave last
};

}  // namespace stgs::player::cuda
