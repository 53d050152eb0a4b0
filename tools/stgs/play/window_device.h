// SPDX-License-Identifier: Apache-2.0
// The Vulkan device of a window, with one queue that renders and presents.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "play/vulkan.h"
#include "vulkan_host/host_device.h"

struct GLFWwindow;

namespace stgs::tools {

class WindowDevice {
 public:
  // Opens the device with the highest rank (stgs_vulkan_support) that can present to the window.
  // `on_message`, if set, receives the messages of the validation layer, if that is
  // installed. kUnsupported without a Vulkan loader or without a suitable device.
  static Result<std::unique_ptr<WindowDevice>> make(
      GLFWwindow* window, std::function<void(const std::string&)> on_message);
  // Users of the device must be destroyed before, and the window after this.
  ~WindowDevice();
  WindowDevice(const WindowDevice&) = delete;
  WindowDevice& operator=(const WindowDevice&) = delete;

  // Only the thread of the renderer may use the queue.
  const DeviceHandles& device() const { return host_.device(); }
  // For the renderer. kRuntime if the library is older than the program.
  Result<stgs_vulkan_device> lent() const;
  VkSurfaceKHR surface() const { return surface_; }
  const std::string& name() const { return name_; }  // of the GPU

 private:
  WindowDevice() = default;
  Status make_instance();
  Result<stgs_vulkan_support> support_of(VkPhysicalDevice device) const;
  Status open();

  std::function<void(const std::string&)> on_message_;
  HostDevice host_;
  VkSurfaceKHR surface_ = VK_NULL_HANDLE;
  std::string name_;
  bool subgroup_size_control_ = false;  // is enabled
};

}  // namespace stgs::tools
