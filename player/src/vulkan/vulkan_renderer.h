// SPDX-License-Identifier: Apache-2.0
// The Vulkan backend. The CPU decodes segments, which stay resident on the device. A frame is one
// command buffer of compute shaders, without host synchronisation until it completes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "stgs/player/renderer.h"

struct VkInstance_T;  // of Vulkan; VkInstance points to it

namespace stgs::player {

class VulkanRenderer;
struct VulkanDevice;

// Settings for tests; the defaults suit all uses.
struct VulkanSettings {
  std::uint64_t initial_instances = 0;  // capacity in tile instances; 0: estimated
  bool use_ballot = true;               // use the subgroup shaders if the device supports them
  std::uint64_t block_bytes = 0;        // of a segment memory block; 0: chosen for the device
  std::uint64_t range_bytes = 0;        // limit for storage buffers; 0: the limit of the device
  // Of Vulkan 1.1, with the own device; the caller destroys it after the renderer. Null: the
  // renderer creates one.
  VkInstance_T* instance = nullptr;
};

// Creates a renderer on an own device (VulkanSupport::rank). kNotBuilt without Vulkan,
// kUnsupported if there is no suitable device.
Result<std::unique_ptr<Renderer>> make_vulkan_renderer(const VulkanSettings& settings = {});
// Creates a renderer on the caller's device (stgs/player/vulkan_renderer.h).
Result<std::unique_ptr<VulkanRenderer>> make_vulkan_renderer(const VulkanDevice& device,
                                                             const VulkanSettings& settings);

}  // namespace stgs::player
