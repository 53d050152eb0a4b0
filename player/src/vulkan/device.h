// SPDX-License-Identifier: Apache-2.0
// A Vulkan device with a queue that computes.
#pragma once

#include <volk.h>

#include <cstdint>
#include <span>
#include <string>

#include "stgs/format/status.h"
#include "stgs/player/vulkan_renderer.h"
#include "vulkan/features.h"
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

// Of an instance: what is called after the device is there.
struct InstanceFunctions {
  PFN_vkGetPhysicalDeviceFormatProperties vkGetPhysicalDeviceFormatProperties = nullptr;
  PFN_vkDestroyDebugUtilsMessengerEXT vkDestroyDebugUtilsMessengerEXT = nullptr;
  PFN_vkDestroyInstance vkDestroyInstance = nullptr;
};

// Of its own or borrowed. One thread at a time.
class Device {
 public:
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;
  ~Device();

  // One of the two, once: makes an instance and a device of its own, or takes the caller's.
  Status create(const VulkanSettings& settings);
  Status borrow(const VulkanDevice& lent);

  // The device's functions.
  VolkDeviceTable vk{};
  VkDevice handle() const { return context_.device; }
  std::uint32_t family() const { return context_.queue_family; }
  const Features& features() const { return features_; }
  VkFormatFeatureFlags features_of(VkFormat format) const;  // of images with optimal tiling
  std::uint64_t most_range() const { return most_range_; }  // bytes of a storage buffer
  // Those that the ballot shaders run with; none where they do not.
  const Subgroups& subgroups() const { return subgroups_; }
  bool ballots() const { return subgroups_.lanes != 0; }
  // Nanoseconds a step of a timestamp; 0 where there are none.
  double timestamp_ns() const { return timestamp_ns_; }
  std::uint64_t timestamp_mask() const { return timestamp_mask_; }
  // Memory of one of the types and with the properties; kRuntime where there is none left.
  Status allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties,
                  VkDeviceMemory* memory) const;
  // A command buffer that is ready to be recorded, and runs it to its end.
  Status begin(VkCommandBuffer* commands);
  Status finish(VkCommandBuffer commands);
  Status submit(std::span<const VkSubmitInfo> batches, VkFence fence);
  Status wait(VkFence fence) const;

 private:
  Status make_instance();
  Status choose();
  Status open();
  void keep_functions();
  void learn_limits();
  Status make_commands();

  VulkanSettings settings_;
  VulkanDevice context_;
  Features features_;  // that the device was made with
  Subgroups subgroups_;
  bool borrowed_ = false;
  bool shares_processors_ = false;  // with the host
  InstanceFunctions instance_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkPhysicalDeviceMemoryProperties memory_{};
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  std::uint64_t most_range_ = 0, timestamp_mask_ = 0;
  double timestamp_ns_ = 0;
};

}  // namespace stgs::player::vulkan
