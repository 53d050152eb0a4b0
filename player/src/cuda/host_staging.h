// SPDX-License-Identifier: Apache-2.0
// Double-buffered pinned memory for uploads from pageable memory: the host fills one half while the
// device reads the other.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/device_buffer.h"

namespace stgs::player::cuda {

// One thread; the current device.
class HostStaging {
 public:
  // `memory` as for GrowingBuffer.
  explicit HostStaging(RendererMemory* memory)
      : halves_{{PinnedBuffer(memory), Event()}, {PinnedBuffer(memory), Event()}} {}
  // Ensures that each half has at least `bytes`.
  Status ensure(std::size_t bytes);
  // Returns the half to fill next. Waits until the device has finished with it.
  Result<std::uint8_t*> next();
  // Enqueues a copy of the first `bytes` of that half to the device.
  Status upload(void* to, std::size_t bytes, cudaStream_t stream);

 private:
  struct Half {
    PinnedBuffer memory;
    Event uploaded;  // the last copy from it
  };
  Half halves_[2];
  int current_ = 0;  // returned by the last next()
};

}  // namespace stgs::player::cuda
