// SPDX-License-Identifier: Apache-2.0
// The Vulkan device of a window, with one queue that renders and presents.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "vulkan_host/host_device.h"

struct GLFWwindow;

namespace stgs::tools {

class WindowDevice {
 public:
  // Opens the first discrete GPU that can present to the window, else another GPU, else a CPU
  // driver. `on_message`, if set, receives the messages of the validation layer, if that is
  // installed. kUnsupported without a Vulkan loader or without a suitable device.
  static Result<std::unique_ptr<WindowDevice>> make(
      GLFWwindow* window, std::function<void(const std::string&)> on_message);
  // Users of the device must be destroyed before, and the window after this.
  ~WindowDevice();
  WindowDevice(const WindowDevice&) = delete;
  WindowDevice& operator=(const WindowDevice&) = delete;

  // For the renderer. Only its thread may use the queue.
  const player::VulkanDevice& device() const { return host_.device(); }
  VkSurfaceKHR surface() const { return surface_; }
  const std::string& name() const { return name_; }  // of the GPU

 private:
  WindowDevice() = default;
  Status make_instance();
  Status open();

  std::function<void(const std::string&)> on_message_;
  HostDevice host_;
  VkSurfaceKHR surface_ = VK_NULL_HANDLE;
  std::string name_;
};

}  // namespace stgs::tools
