// SPDX-License-Identifier: Apache-2.0
// A Vulkan device with a compute queue.
#pragma once

#include <volk.h>

#include <cstdint>
#include <span>
#include <string>

#include "renderer_memory.h"
#include "stgs/format/status.h"
#include "stgs/player/vulkan_renderer.h"
#include "vulkan/features.h"
#include "vulkan/vulkan_renderer.h"

namespace stgs::player::vulkan {

// Returns a zeroed Vulkan structure with its sType.
template <typename T>
T structure(VkStructureType type) {
  T out{};
  out.sType = type;
  return out;
}

// Converts a VkResult. `action` completes "Vulkan failed while ...". Errors: kNoMemory,
// kDeviceLost, else kRuntime.
Status vk_status(VkResult result, const char* action);

// Instance functions that are called after the device is created.
struct InstanceFunctions {
  PFN_vkGetPhysicalDeviceFormatProperties vkGetPhysicalDeviceFormatProperties = nullptr;
  PFN_vkDestroyInstance vkDestroyInstance = nullptr;
};

// An own or borrowed device. One thread at a time.
class Device {
 public:
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  ~Device();

  // Call one of the two, once. Creates an own device, and an own instance unless the settings have
  // one; or borrows the caller's device.
  Status create(const VulkanSettings& settings);
  Status borrow(const VulkanDevice& lent);

  // Charged with the buffers that are created with this device. Outlives them; null: not limited.
  RendererMemory* renderer_memory = nullptr;
  VolkDeviceTable vk{};  // the functions of the device
  VkDevice handle() const { return context_.device; }
  std::uint32_t family() const { return context_.queue_family; }
  const Features& features() const { return features_; }
  // Returns the features of a format for images with optimal tiling.
  VkFormatFeatureFlags features_of(VkFormat format) const;
  std::uint64_t max_range() const { return max_range_; }  // bytes of a storage buffer
  // Returns the subgroups of the ballot shaders; 0 lanes if those are not used.
  const Subgroups& subgroups() const { return subgroups_; }
  bool uses_ballot() const { return subgroups_.lanes != 0; }
  // Returns the nanoseconds per timestamp increment; 0 if timestamps are not supported.
  double timestamp_ns() const { return timestamp_ns_; }
  std::uint64_t timestamp_mask() const { return timestamp_mask_; }
  // Allocates memory of an allowed type with the properties; kNoMemory if there is none left.
  Status allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties,
                  VkDeviceMemory* memory) const;
  // Begins recording the device's own command buffer.
  Status begin(VkCommandBuffer* commands);
  // Submits it and waits until it has completed.
  Status finish(VkCommandBuffer commands);
  Status submit(std::span<const VkSubmitInfo> batches, VkFence fence);
  Status wait(VkFence fence) const;

 private:
  Status create_instance();
  Status create_own_instance();
  Status choose();
  Status open();
  void save_functions();
  void query_limits();
  Status create_commands();

  VulkanSettings settings_;
  VulkanDevice context_;
  Features features_;  // enabled at device creation
  Subgroups subgroups_;
  bool borrowed_ = false;
  bool runs_on_cpu_ = false;
  InstanceFunctions instance_;
  VkPhysicalDeviceMemoryProperties memory_{};
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  std::uint64_t max_range_ = 0, timestamp_mask_ = 0;
  double timestamp_ns_ = 0;
};

}  // namespace stgs::player::vulkan
