// SPDX-License-Identifier: Apache-2.0
// The CUDA backend: segments are decoded and kept on the device; a frame is one graph of kernels
// that the host starts and does not look into before its end.
#pragma once

#include <memory>

#include "stgs/player/renderer.h"

namespace stgs::player {

struct CudaSettings {
  bool use_graph = true;  // else the kernels are started one by one
  // Room to begin with; 0: by the primitives. A frame that needs more is drawn again with more.
  std::uint64_t initial_splats = 0;     // in views
  std::uint64_t initial_instances = 0;  // in tiles
};

// On the current device of the calling thread, which must stay the same. kNotBuilt without CUDA,
// kUnsupported where there is no such device or no code for it.
Result<std::unique_ptr<Renderer>> make_cuda_renderer(const CudaSettings& settings = {});

}  // namespace stgs::player
