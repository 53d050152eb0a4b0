// SPDX-License-Identifier: Apache-2.0
// Access to the input of a frame in kernels.
#pragma once

#include "cuda/draw.h"

namespace stgs::player::cuda {

// Copies the input to shared memory. All threads of the block call it; a barrier must follow.
__device__ inline void load_frame(const FrameInput* from, FrameInput& to) {
  static_assert(sizeof(FrameInput) % sizeof(std::uint32_t) == 0);
  const auto* const words = reinterpret_cast<const std::uint32_t*>(from);
  auto* const out = reinterpret_cast<std::uint32_t*>(&to);
  for (unsigned i = threadIdx.x; i < sizeof(FrameInput) / sizeof(std::uint32_t); i += blockDim.x) {
    out[i] = words[i];
  }
}

__device__ inline const Part* parts_of(const FrameInput* input) {
  return reinterpret_cast<const Part*>(input + 1);
}

}  // namespace stgs::player::cuda
