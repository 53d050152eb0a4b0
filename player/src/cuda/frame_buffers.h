// SPDX-License-Identifier: Apache-2.0
// The working memory of a frame.
#pragma once

#include <cstdint>

#include "cuda/device_buffer.h"
#include "cuda/draw.h"

namespace stgs::player::cuda {

// Capacities that a frame requires; 0: the present capacity suffices.
struct FrameNeed {
  std::uint32_t chunks = 0;  // of primitives, all of which may be candidates
  std::uint32_t tiles = 0;
  std::uint64_t splats = 0;
  std::uint64_t instances = 0;
};

class FrameBuffers {
 public:
  // `memory` as for GrowingBuffer.
  explicit FrameBuffers(RendererMemory* memory)
      : cleared_(memory),
        candidates_(memory),
        splats_(memory),
        depths_(memory),
        instances_(memory),
        patches_(memory) {}
  // Grows the buffers to the capacities, which discards their contents and changes addresses.
  // Errors as for GrowingBuffer.
  Status ensure(const FrameNeed& need);
  // Frees all buffers.
  void reset();
  // Increases whenever addresses change.
  std::uint64_t generation() const { return generation_; }
  std::uint64_t splat_capacity() const { return capacity_.splats; }
  std::uint64_t instance_capacity() const { return capacity_.instances; }
  // Returns the buffers for a frame with a number of tiles.
  Workspace workspace(std::uint32_t tiles) const;
  std::size_t cleared_bytes() const { return cleared_bytes_; }
  // Starts clearing the buffers that must be zero at the beginning of a frame.
  cudaError_t clear(cudaStream_t stream) const;

 private:
  FrameNeed capacity_;
  std::uint64_t generation_ = 0;
  std::size_t cleared_bytes_ = 0;
  Workspace laid_out_;
  DeviceBuffer cleared_, candidates_, splats_, depths_, instances_, patches_;
};

}  // namespace stgs::player::cuda
