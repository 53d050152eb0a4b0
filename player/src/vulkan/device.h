// SPDX-License-Identifier: Apache-2.0
// A Vulkan device with a queue that computes.
#pragma once

#include <volk.h>

#include <cstdint>
#include <string>

#include "stgs/format/status.h"
#include "vulkan/vulkan_renderer.h"

namespace stgs::player::vulkan {

// kRuntime where the call failed.
Status vk_status(VkResult result, const char* what);

// A zeroed Vulkan structure that says what it is.
template <typename T>
T structure(VkStructureType type) {
  T made{};
  made.sType = type;
  return made;
}

// What a renderer draws with, whoever owns it.
struct VulkanContext {
  VkInstance instance = VK_NULL_HANDLE;  // of API version 1.1 at least, as the device
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  std::uint32_t family = 0;
  VkQueue queue = VK_NULL_HANDLE;  // of the family, which computes
};

// One thread; the queue is nobody else's meanwhile.
class Device {
 public:
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  ~Device();

  // Makes an instance and a device of its own.
  Status create(const VulkanSettings& settings);

  // The device's functions.
  VolkDeviceTable vk{};
  VkDevice handle() const { return context_.device; }
  std::uint64_t most_range() const { return most_range_; }  // bytes of a storage buffer
  // Of the subgroups if the ballot shaders run with them, else 0.
  std::uint32_t ballot_lanes() const { return ballot_lanes_; }
  // Nanoseconds a step of a timestamp; 0 where there are none.
  double timestamp_ns() const { return timestamp_ns_; }
  std::uint64_t timestamp_mask() const { return timestamp_mask_; }
  // Memory of one of the types and with the properties; kRuntime where there is none left.
  Status allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties,
                  VkDeviceMemory* memory) const;
  // A command buffer that is ready to be recorded, and runs it to its end.
  Status begin(VkCommandBuffer* commands);
  Status finish(VkCommandBuffer commands);

 private:
  Status make_instance();
  Status choose();
  Status open();
  void learn_limits();
  Status make_commands();

  VulkanSettings settings_;
  VulkanContext context_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkPhysicalDeviceMemoryProperties memory_{};
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  std::uint64_t most_range_ = 0, timestamp_mask_ = 0;
  std::uint32_t ballot_lanes_ = 0;
  double timestamp_ns_ = 0;
};

}  // namespace stgs::player::vulkan
