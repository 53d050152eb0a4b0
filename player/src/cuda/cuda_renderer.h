// SPDX-License-Identifier: Apache-2.0
// The CUDA backend. Segments are decoded and stay resident on the device. A frame is one graph of
// kernels, without host synchronisation until it completes.
#pragma once

#include <memory>

#include "stgs/player/cuda_renderer.h"

namespace stgs::player {

// Settings for tests; the defaults suit all uses.
struct CudaSettings {
  bool use_graph = true;  // false: launch the kernels one by one
  // Initial capacities; 0: estimated. A frame that needs more is rendered again with larger
  // buffers.
  std::uint64_t initial_splats = 0;     // over the views
  std::uint64_t initial_instances = 0;  // in tiles
};

// Creates a CudaRenderer on the current device of the calling thread, which must stay the current
// one. kNotBuilt without CUDA, kUnsupported if there is no device or this build has no code for it.
Result<std::unique_ptr<Renderer>> make_cuda_renderer(const CudaSettings& settings = {});

}  // namespace stgs::player
