// SPDX-License-Identifier: Apache-2.0
// The application's Vulkan device, and the little that the examples make with it. An example throws
// std::runtime_error where something fails, Unsupported where the machine lacks something.
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

// Throws where a call of Vulkan's or of STGS's failed.
void must(VkResult result, const char* what);
void must(stgs_result result, stgs_renderer* renderer);
void must(stgs_result result, stgs_scene* scene);
void must(stgs_result result, stgs_player* player);

// Who makes the instance and the device: Vulkan itself, or OpenXR, which adds what it needs.
struct Makers {
  std::function<VkResult(const VkInstanceCreateInfo&, VkInstance*)> instance;
  // Null: the first that draws.
  std::function<VkPhysicalDevice(VkInstance)> choose;
  std::function<VkResult(VkPhysicalDevice, const VkDeviceCreateInfo&, VkDevice*)> device;
};
Makers vulkan_makers();

struct Image {
  VkImage image = VK_NULL_HANDLE;
  VkImageView view = VK_NULL_HANDLE;
  VkFormat format = VK_FORMAT_UNDEFINED;
  std::uint32_t width = 0, height = 0;
};

// Vulkan 1.3 with one queue that draws and computes. One thread.
class Gpu {
 public:
  explicit Gpu(const Makers& makers);
  ~Gpu();  // ends all that was made with it
  Gpu(const Gpu&) = delete;
  Gpu& operator=(const Gpu&) = delete;

  VkInstance instance = VK_NULL_HANDLE;
  VkPhysicalDevice physical_device = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  std::uint32_t queue_family = 0;

  // The device as STGS borrows it.
  stgs_vulkan_device lent() const;

  Image make_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                   VkImageUsageFlags usage, VkImageAspectFlags aspect);
  // The caller's to destroy.
  VkImageView make_view(VkImage image, VkFormat format, VkImageAspectFlags aspect) const;
  VkSemaphore make_timeline();
  VkShaderModule make_shader(std::span<const std::uint32_t> code);
  VkCommandBuffer make_commands();
  // The pixels of an image of RGBA or BGRA, 4 bytes each, red first, which is in `layout` and stays
  // in it; waits for all that the queue has to do.
  std::vector<std::uint8_t> read(const Image& image, VkImageLayout layout);
  // Called when the device ends, in the opposite order.
  void at_end(std::function<void()> end) { ends_.push_back(std::move(end)); }

 private:
  Gpu() = default;  // so that what a constructor has made ends where it throws
  void choose(const Makers& makers);
  VkDeviceMemory allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties);

  VkCommandPool pool_ = VK_NULL_HANDLE;
  std::vector<std::function<void()>> ends_;
};

// A barrier of a whole image, from all that came before to all that follows.
void change_layout(VkCommandBuffer commands, VkImage image, VkImageLayout from, VkImageLayout to,
                   VkImageAspectFlags aspect = VK_IMAGE_ASPECT_COLOR_BIT);

// Opaque, 4 bytes a pixel: red, green, blue and something.
void write_png(const std::string& path, std::uint32_t width, std::uint32_t height,
               std::vector<std::uint8_t> pixels);

}  // namespace app
