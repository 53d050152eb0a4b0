// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/renderer.h"

#include "cpu/cpu_renderer.h"

namespace stgs::player {

Result<std::unique_ptr<Renderer>> make_renderer(const std::string& backend) {
  if (backend == "auto" || backend == "cpu") return make_cpu_renderer();
  if (backend == "cuda" || backend == "vulkan") {
    return not_built("backend '{}' is not part of this build; use --backend cpu", backend);
  }
  return usage_error("backend '{}' is not known; use auto, cpu, cuda or vulkan", backend);
}

std::vector<std::string> renderer_backends() {
  return {"cpu"};
}

}  // namespace stgs::player
