// SPDX-License-Identifier: Apache-2.0
// An application with its own Vulkan device, images and semaphores, which lends the device to the
// renderer.
#pragma once

#include <volk.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "stgs/player/vulkan_renderer.h"

namespace stgs::testing {

// A device-local image, owned by the host that made it.
struct HostImage {
  VkImage image = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;
};

// Exits with a message if a Vulkan call fails.
class VulkanHost {
 public:
  // Returns null without a loader or a device. `features`: enables the features that the renderer
  // uses and the device supports.
  static std::unique_ptr<VulkanHost> make(bool features);
  ~VulkanHost();
  VulkanHost(const VulkanHost&) = delete;
  VulkanHost& operator=(const VulkanHost&) = delete;

  const player::VulkanDevice& device() const { return device_; }
  bool controls_subgroup_sizes() const { return !device_.extensions.empty(); }
  // The messages of the validation layer, of all hosts.
  static std::vector<std::string>& messages();

  HostImage make_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                       std::uint32_t levels = 1, std::uint32_t layers = 1);
  // Waits for the queue and returns the bytes of one level and layer, row by row. The image is in
  // `layout`.
  std::vector<std::uint8_t> read(const HostImage& image, VkImageLayout layout,
                                 std::uint32_t pixel_bytes, std::uint32_t level = 0,
                                 std::uint32_t layer = 0);
  VkSemaphore make_timeline(std::uint64_t value);
  void signal(VkSemaphore semaphore, std::uint64_t value);
  std::uint64_t value_of(VkSemaphore semaphore);

 private:
  VulkanHost() = default;
  bool make_instance();
  bool make_device(bool features);
  VkDeviceMemory allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties);

  player::VulkanDevice device_;
  VkPhysicalDeviceSubgroupSizeControlFeatures sizes_{};
  VkPhysicalDeviceTimelineSemaphoreFeatures timeline_{};
  VkPhysicalDeviceFeatures2 features_{};
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  std::vector<HostImage> images_;
  std::vector<VkSemaphore> semaphores_;
};

}  // namespace stgs::testing
