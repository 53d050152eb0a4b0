// SPDX-License-Identifier: Apache-2.0
// The CUDA renderer in the renderer_*_cases.cpp. Its variant launches kernels one by one instead of
// by a graph.
#include "cuda/cuda_renderer.h"
#include "renderer_under_test.h"

namespace stgs::testing {

Result<std::unique_ptr<player::Renderer>> make_renderer_under_test(const UnderTest& settings) {
  return player::make_cuda_renderer({.use_graph = !settings.variant,
                                     .initial_splats = settings.instances,
                                     .initial_instances = settings.instances});
}

}  // namespace stgs::testing
