// SPDX-License-Identifier: Apache-2.0
// A Vulkan device that shows pictures in a window, and its one queue.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "play/vulkan_objects.h"
#include "stgs/player/vulkan_renderer.h"

struct GLFWwindow;

namespace stgs::tools {

class WindowDevice {
 public:
  // The first discrete GPU that can show in the window, else another GPU, else a processor.
  // `on_message`, where set, is told what the validation layer says, if that is installed.
  // kUnsupported without a Vulkan loader, or without such a device.
  static Result<std::unique_ptr<WindowDevice>> make(
      GLFWwindow* window, std::function<void(const std::string&)> on_message);
  // All that uses the device is gone, and the window is still there.
  ~WindowDevice();
  WindowDevice(const WindowDevice&) = delete;
  WindowDevice& operator=(const WindowDevice&) = delete;

  // For the renderer, whose thread is the only one that uses the queue.
  const player::VulkanDevice& device() const { return device_; }
  VkSurfaceKHR surface() const { return surface_; }
  const std::string& name() const { return name_; }  // of the GPU

 private:
  WindowDevice() = default;
  Status make_instance();
  Status choose();
  Status open();

  std::function<void(const std::string&)> on_message_;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkSurfaceKHR surface_ = VK_NULL_HANDLE;
  player::VulkanDevice device_;
  VkPhysicalDeviceSubgroupSizeControlFeatures sizes_{};  // where there are such; of `features_`
  VkPhysicalDeviceFeatures2 features_{};
  std::string name_;
};

}  // namespace stgs::tools
