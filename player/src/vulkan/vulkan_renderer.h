// SPDX-License-Identifier: Apache-2.0
// The Vulkan backend: segments are decoded by the processor and kept on the device; a frame is one
// command buffer of compute shaders that the host does not look into before its end.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "stgs/player/renderer.h"

namespace stgs::player {

class VulkanRenderer;
struct VulkanDevice;

struct VulkanSettings {
  std::uint64_t initial_instances =
      0;                          // room for splats in tiles to begin with; 0: by the primitives
  bool use_ballot = true;         // the shaders for subgroups of 16 or 32 where there are such
  std::uint64_t block_bytes = 0;  // of a block of segments; 0: as the device allows
  std::uint64_t range_bytes = 0;  // that storage buffers have at most; 0: as the device allows
  // Where set, the validation layer runs, if it is installed, and tells its messages here. Of a
  // device of the renderer's own.
  std::function<void(const std::string&)> on_message;
};

// A device of the renderer's own (vulkan_device_rank). kNotBuilt without
// Vulkan, kUnsupported where there is no device that can draw.
Result<std::unique_ptr<Renderer>> make_vulkan_renderer(const VulkanSettings& settings = {});
// On the caller's device (stgs/player/vulkan_renderer.h).
Result<std::unique_ptr<VulkanRenderer>> make_vulkan_renderer(const VulkanDevice& device,
                                                             const VulkanSettings& settings);

}  // namespace stgs::player
