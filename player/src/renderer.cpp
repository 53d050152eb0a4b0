// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/renderer.h"

#include "cpu/cpu_renderer.h"
#include "cuda/cuda_renderer.h"
#include "vulkan/vulkan_renderer.h"

namespace stgs::player {

#if !STGS_HAS_CUDA
Result<std::unique_ptr<Renderer>> make_cuda_renderer(const CudaSettings&) {
  return not_built("backend 'cuda' is not part of this build; use backend '{}'",
                   fmt::format("{}", fmt::join(renderer_backends(), "' or '")));
}
#endif
#if !STGS_HAS_VULKAN
Result<std::unique_ptr<Renderer>> make_vulkan_renderer(const VulkanSettings&) {
  return not_built("backend 'vulkan' is not part of this build; use backend 'cpu'");
}
#endif

Result<std::unique_ptr<Renderer>> make_renderer(const std::string& backend) {
  if (backend == "cpu") return make_cpu_renderer();
  if (backend == "cuda") return make_cuda_renderer();
  if (backend == "vulkan") return make_vulkan_renderer();
  if (backend == "auto") {
    auto cuda = make_cuda_renderer();
    const StatusCode code = cuda.status().code();
    if (code != StatusCode::kNotBuilt && code != StatusCode::kUnsupported) return cuda;
    return make_cpu_renderer();
  }
  return usage_error("unknown backend '{}'; use auto, cpu, cuda or vulkan", backend);
}

std::vector<std::string> renderer_backends() {
  std::vector<std::string> names;
#if STGS_HAS_CUDA
  names.push_back("cuda");
#endif
  names.push_back("cpu");
#if STGS_HAS_VULKAN
  names.push_back("vulkan");
#endif
  return names;
}

}  // namespace stgs::player
