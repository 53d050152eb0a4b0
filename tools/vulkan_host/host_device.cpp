// SPDX-License-Identifier: Apache-2.0
#include "vulkan_host/host_device.h"

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
  if (device_.instance == VK_NULL_HANDLE) return;
  if (messenger_ != VK_NULL_HANDLE) {
    vkDestroyDebugUtilsMessengerEXT(device_.instance, messenger_, nullptr);
  }
  vkDestroyInstance(device_.instance, nullptr);
}

VkResult HostDevice::make_instance(const player::VulkanInstanceSettings& settings) {
  player::VulkanInstance made;
  const VkResult result = make_vulkan_instance(settings, made);
  if (result != VK_SUCCESS) return result;
  device_.instance = made.instance;
  device_.api_version = settings.api_version;
  messenger_ = made.messenger;
  volkLoadInstance(device_.instance);
  return result;
}

Status HostDevice::open(const Request& request) {
  device_.physical_device = request.physical_device;
  device_.queue_family = request.queue_family;
  device_.extensions = request.extensions;
  features_ = structure<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
  if (request.timeline_semaphores) {
    timeline_ = structure<VkPhysicalDeviceTimelineSemaphoreFeatures>(
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES);
    timeline_.timelineSemaphore = VK_TRUE;
    features_.pNext = &timeline_;
  }
  if (request.subgroup_size_control) {
    STGS_ASSIGN(const player::VulkanSupport offered,
                player::vulkan_support(nullptr, device_.instance, device_.api_version,
                                       device_.physical_device));
    if (offered.subgroup_size_control) {
      sizes_ = structure<VkPhysicalDeviceSubgroupSizeControlFeatures>(
          VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES);
      sizes_.subgroupSizeControl = sizes_.computeFullSubgroups = VK_TRUE;
      sizes_.pNext = std::exchange(features_.pNext, &sizes_);
      device_.extensions.emplace_back(VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME);
    }
  }
  const float priority = 1;
  auto queue = structure<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue.queueFamilyIndex = device_.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  std::vector<const char*> extensions;
  for (const std::string& one : device_.extensions) extensions.push_back(one.c_str());
  auto info = structure<VkDeviceCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO);
  info.pNext = &features_;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  info.enabledExtensionCount = static_cast<std::uint32_t>(extensions.size());
  info.ppEnabledExtensionNames = extensions.data();
  const VkResult result = vkCreateDevice(device_.physical_device, &info, nullptr, &device_.device);
  if (result != VK_SUCCESS) device_.device = VK_NULL_HANDLE;
  STGS_TRY(vk_status(result, "creating a device"));
  device_.features = &features_;
  volkLoadDevice(device_.device);
  vkGetDeviceQueue(device_.device, device_.queue_family, 0, &device_.queue);
  return {};
}

void HostDevice::close() {
  if (device_.device == VK_NULL_HANDLE) return;
  vkDeviceWaitIdle(device_.device);
  vkDestroyDevice(device_.device, nullptr);
  device_.device = VK_NULL_HANDLE;
}

}  // namespace stgs::tools
