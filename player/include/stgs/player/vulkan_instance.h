// SPDX-License-Identifier: Apache-2.0
// Creates Vulkan instances and structures for the renderer and for this project's programs. Only in
// builds with Vulkan (STGS_WITH_VULKAN).
#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace stgs::player {

// Returns a zeroed Vulkan structure with its sType.
template <typename T>
T structure(VkStructureType type) {
  T out{};
  out.sType = type;
  return out;
}

// Settings of make_vulkan_instance().
struct VulkanInstanceSettings {
  const char* application = nullptr;  // application name; may be null
  std::uint32_t api_version = VK_API_VERSION_1_1;
  std::vector<const char*> extensions;
  // If set, enables the validation layer with synchronisation validation, provided that the layer
  // is installed, and receives its warnings and errors on any thread. Outlives the instance.
  const std::function<void(const std::string&)>* on_message = nullptr;
};

// Owned by the caller, who destroys the messenger first.
struct VulkanInstance {
  VkInstance instance = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;  // null: validation is off
};

// Returns the rank of a device type, greater than 0. Of several devices, the first with the highest
// rank renders: discrete GPUs rank above other GPUs, and those above CPU drivers.
inline int vulkan_device_rank(VkPhysicalDeviceType type) {
  if (type == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU) return 3;
  return type == VK_PHYSICAL_DEVICE_TYPE_CPU ? 1 : 2;
}

// Creates an instance. Call it after volkInitialize(); it does not load volk's instance functions.
// On failure, the handles in `out` are null.
VkResult make_vulkan_instance(const VulkanInstanceSettings& settings, VulkanInstance& out);

}  // namespace stgs::player
