// SPDX-License-Identifier: Apache-2.0
// An instance of Vulkan for this project's own programs and renderers. In builds with Vulkan
// (STGS_WITH_VULKAN) alone.
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace stgs::player {

struct VulkanInstanceSettings {
  const char* application = nullptr;  // its name; may be null
  std::uint32_t api_version = VK_API_VERSION_1_1;
  std::vector<const char*> extensions;
  // Where it is set, the validation layer runs, synchronisation validation included, if it is
  // installed, and tells its warnings and errors here, on any thread. It must last as long as the
  // instance.
  const std::function<void(const std::string&)>* on_message = nullptr;
};

// The caller's to destroy, the messenger first.
struct VulkanInstance {
  VkInstance instance = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;  // null: nothing validates
};

// Which of several devices draws: of the highest rank, > 0, the first. A discrete GPU comes before
// others, and all of them before drivers of the processor.
inline int vulkan_device_rank(VkPhysicalDeviceType type) {
  if (type == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU) return 3;
  return type == VK_PHYSICAL_DEVICE_TYPE_CPU ? 1 : 2;
}

// After volkInitialize, and before volk's functions of instances are loaded, which this does not.
// `out` has null handles after an error.
VkResult make_vulkan_instance(const VulkanInstanceSettings& settings, VulkanInstance& out);

}  // namespace stgs::player
