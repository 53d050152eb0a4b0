// SPDX-License-Identifier: Apache-2.0
#include "vulkan_host/host_device.h"

#include <utility>

namespace stgs::tools {

Result<std::vector<VkPhysicalDevice>> physical_devices(VkInstance instance) {
  std::uint32_t count = 0;
  STGS_TRY(
      vk_status(vkEnumeratePhysicalDevices(instance, &count, nullptr), "counting the devices"));
  std::vector<VkPhysicalDevice> devices(count);
  STGS_TRY(vk_status(vkEnumeratePhysicalDevices(instance, &count, devices.data()),
                     "listing the devices"));
  return devices;
}

int find_queue_family(VkPhysicalDevice device, VkQueueFlags flags,
                      const std::function<bool(std::uint32_t)>& accepts) {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  for (std::uint32_t i = 0; i < count; ++i) {
    if ((families[i].queueFlags & flags) != flags) continue;
    if (!accepts || accepts(i)) return static_cast<int>(i);
  }
  return -1;
}

HostDevice::~HostDevice() {
  close();
  destroy_instance(instance_);
}

VkResult HostDevice::make_instance(const InstanceSettings& settings) {
  const VkResult result = tools::make_instance(settings, instance_);
  if (result != VK_SUCCESS) return result;
  handles_.instance = instance_.handle;
  handles_.api_version = settings.api_version;
  volkLoadInstance(handles_.instance);
  return result;
}

Status HostDevice::open(const Request& request) {
  handles_.physical_device = request.physical_device;
  handles_.queue_family = request.queue_family;
  extensions_ = request.extensions;
  features_ = structure<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
  if (request.timeline_semaphores) {
    timeline_ = structure<VkPhysicalDeviceTimelineSemaphoreFeatures>(
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES);
    timeline_.timelineSemaphore = VK_TRUE;
    features_.pNext = &timeline_;
  }
  if (request.subgroup_size_control) {
    sizes_ = structure<VkPhysicalDeviceSubgroupSizeControlFeatures>(
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES);
    sizes_.subgroupSizeControl = sizes_.computeFullSubgroups = VK_TRUE;
    sizes_.pNext = std::exchange(features_.pNext, &sizes_);
    extensions_.emplace_back(VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME);
  }
  const float priority = 1;
  auto queue = structure<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue.queueFamilyIndex = handles_.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  std::vector<const char*> extensions;
  for (const std::string& one : extensions_) extensions.push_back(one.c_str());
  auto info = structure<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO);
  info.pNext = &features_;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  info.enabledExtensionCount = static_cast<std::uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  const VkResult result =
      vkCreateDevice(handles_.physical_device, &info, nullptr, &handles_.device);
  if (result != VK_SUCCESS) handles_.device = VK_NULL_HANDLE;
  STGS_TRY(vk_status(result, "creating a device"));
  volkLoadDevice(handles_.device);
  vkGetDeviceQueue(handles_.device, handles_.queue_family, 0, &handles_.queue);
  return {};
}

void HostDevice::close() {
  if (handles_.device == VK_NULL_HANDLE) return;
  vkDeviceWaitIdle(handles_.device);
  vkDestroyDevice(handles_.device, nullptr);
  handles_.device = VK_NULL_HANDLE;
}

}  // namespace stgs::tools
