// SPDX-License-Identifier: Apache-2.0
// The Vulkan instance and device of a program, with one queue.
#pragma once

#include <string>
#include <vector>

#include "vulkan_host/instance.h"
#include "vulkan_host/objects.h"

namespace stgs::tools {

// Returns the devices of an instance, in the order of the loader.
Result<std::vector<VkPhysicalDevice>> physical_devices(VkInstance instance);
// Returns the first queue family of a device that supports all of `flags` and that `accepts`
// accepts, or -1. `accepts` may be empty.
int find_queue_family(VkPhysicalDevice device, VkQueueFlags flags,
                      const std::function<bool(std::uint32_t)>& accepts = {});

// Not thread-safe.
class HostDevice {
 public:
  HostDevice() = default;
  HostDevice(const HostDevice&) = delete;
  HostDevice& operator=(const HostDevice&) = delete;
  ~HostDevice();

  // Creates the instance and loads its functions. Call it once, after volkInitialize().
  VkResult make_instance(const InstanceSettings& settings);

  struct Request {
    VkPhysicalDevice physical_device = VK_NULL_HANDLE;
    std::uint32_t queue_family = 0;
    std::vector<std::string> extensions;
    bool timeline_semaphores = false;
    bool subgroup_size_control = false;  // with computeFullSubgroups
  };
  // Creates the device and loads its functions. No device may be open.
  Status open(const Request& request);
  // Waits for the device and destroys it; its objects must have been destroyed. No effect if none
  // is open.
  void close();

  // The instance, if it was made, and the device, if it is open.
  const DeviceHandles& device() const { return handles_; }
  // The features and extensions that the device was opened with. Valid while this exists.
  const VkPhysicalDeviceFeatures2& features() const { return features_; }
  const std::vector<std::string>& extensions() const { return extensions_; }
  // Returns whether the validation layer is on.
  bool is_validated() const { return instance_.messenger != VK_NULL_HANDLE; }

 private:
  Instance instance_;
  DeviceHandles handles_;
  std::vector<std::string> extensions_;
  VkPhysicalDeviceFeatures2 features_{};
  VkPhysicalDeviceTimelineSemaphoreFeatures timeline_{};
  VkPhysicalDeviceSubgroupSizeControlFeatures sizes_{};
};

}  // namespace stgs::tools
