// SPDX-License-Identifier: Apache-2.0
// The working memory of a frame.
#pragma once

#include <cstdint>

#include "cuda/device_buffer.h"
#include "cuda/draw.h"

namespace stgs::player::cuda {

// What a frame may need; 0: no more than there is.
struct FrameNeed {
  std::uint32_t chunks = 0;  // of primitives, each of which may be a candidate
  std::uint32_t tiles = 0;
  std::uint64_t splats = 0;
  std::uint64_t instances = 0;
};

class FrameBuffers {
 public:
  // Makes room; what the buffers held is lost where they grow, and addresses change. kRuntime
  // where the device has no memory left.
  Status ensure(const FrameNeed& need);
  // Gives all of it back.
  void reset();
  // Counts up when addresses have changed.
  std::uint64_t generation() const { return generation_; }
  std::uint64_t splat_capacity() const { return capacity_.splats; }
  std::uint64_t instance_capacity() const { return capacity_.instances; }
  // The buffers as a frame of so many tiles uses them.
  Workspace workspace(std::uint32_t tiles) const;
  std::size_t cleared_bytes() const { return cleared_bytes_; }
  // Starts clearing what must be clear before a frame.
  cudaError_t clear(cudaStream_t stream) const;

 private:
  FrameNeed capacity_;
  std::uint64_t generation_ = 0;
  std::size_t cleared_bytes_ = 0;
  Workspace laid_out_;
  DeviceBuffer cleared_, candidates_, splats_, depths_, instances_, patches_;
};

}  // namespace stgs::player::cuda
