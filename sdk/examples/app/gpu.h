// SPDX-License-Identifier: Apache-2.0
// The Vulkan device of the application, and helpers of the examples. Functions throw
// std::runtime_error on failure and Unsupported if the machine lacks something.
#pragma once

#include <stgs/stgs_vulkan.h>
#include <vulkan/vulkan.h>

#include <cstdint>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace app {

struct Unsupported : std::runtime_error {
  using runtime_error::runtime_error;
};

// Throws unless the result of a Vulkan or STGS call is success.
void check(VkResult result, const char* operation);
void check(stgs_result result, stgs_renderer* renderer);
void check(stgs_result result, stgs_scene* scene);
void check(stgs_result result, stgs_player* player);

// Creates the instance and the device: plain Vulkan, or OpenXR, which adds its requirements.
struct DeviceFactory {
  std::function<VkResult(const VkInstanceCreateInfo&, VkInstance*)> create_instance;
  // Empty: the first suitable device.
  std::function<VkPhysicalDevice(VkInstance)> choose_device;
  std::function<VkResult(VkPhysicalDevice, const VkDeviceCreateInfo&, VkDevice*)> create_device;
};
DeviceFactory vulkan_factory();

struct Image {
  VkImage image = VK_NULL_HANDLE;
  VkImageView view = VK_NULL_HANDLE;
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;
};

// A Vulkan 1.3 device with one queue for graphics and compute. One thread at a time.
class Gpu {
 public:
  explicit Gpu(const DeviceFactory& factory);
  ~Gpu();  // destroys everything created with it
  Gpu(const Gpu&) = delete;
  Gpu& operator=(const Gpu&) = delete;

  VkInstance instance = VK_NULL_HANDLE;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  std::uint32_t queue_family = 0;

  // Returns the device for STGS.
  stgs_vulkan_device stgs_device() const;

  Image create_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                     VkImageUsageFlags usage, VkImageAspectFlags aspect);
  // The caller destroys the view.
  VkImageView create_view(VkImage image, VkFormat format, VkImageAspectFlags aspect) const;
  VkSemaphore create_timeline();
  VkShaderModule create_shader(std::span<const std::uint32_t> code);
  VkCommandBuffer allocate_commands();
  // Returns the pixels of an RGBA or BGRA image, 4 bytes each, red first. The image is in `layout`
  // and stays in it. Waits for the queue to become idle.
  std::vector<std::uint8_t> read(const Image& image, VkImageLayout layout);
  // Registers a function that the destructor calls, in reverse order.
  void defer(std::function<void()> cleanup) { cleanups_.push_back(std::move(cleanup)); }

 private:
  Gpu() = default;  // delegated to, so that the destructor runs if a constructor throws
  void choose(const DeviceFactory& factory);
  VkDeviceMemory allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties);

  VkCommandPool pool_ = VK_NULL_HANDLE;
  std::vector<std::function<void()>> cleanups_;
};

// Records a barrier for an entire image, between all earlier and all later commands.
void change_layout(VkCommandBuffer commands, VkImage image, VkImageLayout from, VkImageLayout to,
                   VkImageAspectFlags aspect = VK_IMAGE_ASPECT_COLOR_BIT);

// Writes an opaque PNG from 4 bytes per pixel: red, green, blue and an ignored byte.
void write_png(const std::string& path, std::uint32_t width, std::uint32_t height,
               std::vector<std::uint8_t> pixels);

}  // namespace app
