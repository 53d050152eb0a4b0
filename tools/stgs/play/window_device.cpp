// SPDX-License-Identifier: Apache-2.0
#include "play/window_device.h"

#include <GLFW/glfw3.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "session.h"
#include "stgs/player/vulkan_instance.h"

namespace stgs::tools {
namespace {

bool has_swapchains(VkPhysicalDevice device) {
  std::uint32_t count = 0;
  if (vkEnumerateDeviceExtensionProperties(device, nullptr, &count, nullptr) != VK_SUCCESS) {
    return false;
  }
  std::vector<VkExtensionProperties> all(count);
  if (vkEnumerateDeviceExtensionProperties(device, nullptr, &count, all.data()) != VK_SUCCESS) {
    return false;
  }
  return std::any_of(all.begin(), all.end(), [](const VkExtensionProperties& one) {
    return std::strcmp(one.extensionName, VK_KHR_SWAPCHAIN_EXTENSION_NAME) == 0;
  });
}

// Returns a queue family with graphics, compute and presentation to the surface, or -1.
int family_of(VkPhysicalDevice device, VkSurfaceKHR surface) {
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(device, &properties);
  if (properties.apiVersion < VK_API_VERSION_1_1 || !has_swapchains(device)) return -1;
  std::uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  for (std::uint32_t i = 0; i < count; ++i) {
    constexpr VkQueueFlags kBoth = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
    if ((families[i].queueFlags & kBoth) != kBoth) continue;
    VkBool32 presents = VK_FALSE;
    if (vkGetPhysicalDeviceSurfaceSupportKHR(device, i, surface, &presents) == VK_SUCCESS &&
        presents == VK_TRUE) {
      return static_cast<int>(i);
    }
  }
  return -1;
}

}  // namespace

Result<std::unique_ptr<WindowDevice>> WindowDevice::make(
    GLFWwindow* window, std::function<void(const std::string&)> on_message) {
  std::unique_ptr<WindowDevice> made(new WindowDevice);
  made->on_message_ = std::move(on_message);
  STGS_TRY(made->make_instance());
  STGS_TRY(
      vk_status(glfwCreateWindowSurface(made->device_.instance, window, nullptr, &made->surface_),
                "creating a window surface"));
  STGS_TRY(made->choose());
  STGS_TRY(made->open());
  return made;
}

WindowDevice::~WindowDevice() {
  if (device_.device != VK_NULL_HANDLE) {
    vkDeviceWaitIdle(device_.device);
    vkDestroyDevice(device_.device, nullptr);
  }
  if (device_.instance == VK_NULL_HANDLE) return;
  vkDestroySurfaceKHR(device_.instance, surface_, nullptr);
  if (messenger_ != VK_NULL_HANDLE) {
    vkDestroyDebugUtilsMessengerEXT(device_.instance, messenger_, nullptr);
  }
  vkDestroyInstance(device_.instance, nullptr);
}

Status WindowDevice::make_instance() {
  std::uint32_t count = 0;
  const char** needed = nullptr;
  if (volkInitialize() == VK_SUCCESS && glfwVulkanSupported() == GLFW_TRUE) {
    needed = glfwGetRequiredInstanceExtensions(&count);
  }
  if (needed == nullptr) {
    return unsupported(
        "no Vulkan driver can present to this display; install one (Debian: mesa-vulkan-drivers), "
        "or use 'stgs render'");
  }
  player::VulkanInstanceSettings settings;
  settings.application = "stgs play";
  settings.api_version = device_.api_version = VK_API_VERSION_1_1;
  settings.extensions.assign(needed, needed + count);
  if (on_message_ != nullptr) settings.on_message = &on_message_;
  player::VulkanInstance made;
  const VkResult result = make_vulkan_instance(settings, made);
  if (result != VK_SUCCESS) {
    return unsupported("cannot create a Vulkan instance (VkResult {})", static_cast<int>(result));
  }
  device_.instance = made.instance;
  messenger_ = made.messenger;
  volkLoadInstance(device_.instance);
  return {};
}

Status WindowDevice::choose() {
  std::uint32_t count = 0;
  STGS_TRY(vk_status(vkEnumeratePhysicalDevices(device_.instance, &count, nullptr),
                     "counting the devices"));
  std::vector<VkPhysicalDevice> devices(count);
  STGS_TRY(vk_status(vkEnumeratePhysicalDevices(device_.instance, &count, devices.data()),
                     "listing the devices"));
  int best = 0;
  for (const VkPhysicalDevice candidate : devices) {
    const int family = family_of(candidate, surface_);
    VkPhysicalDeviceProperties properties{};
    vkGetPhysicalDeviceProperties(candidate, &properties);
    const int rank = player::vulkan_device_rank(properties.deviceType);
    if (family < 0 || rank <= best) continue;
    STGS_ASSIGN(const player::VulkanSupport offered,
                player::vulkan_support(nullptr, device_.instance, device_.api_version, candidate));
    if (!offered.missing_features.empty()) continue;
    best = rank;
    device_.physical_device = candidate;
    device_.queue_family = static_cast<std::uint32_t>(family);
    name_ = properties.deviceName;
  }
  if (best > 0) return {};
  return unsupported("no Vulkan device can render to this window ({} found); use 'stgs render'",
                     plural(std::ssize(devices), "device"));
}

Status WindowDevice::open() {
  const float priority = 1;
  auto queue = structure<VkDeviceQueueCreateInfo>(VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO);
  queue.queueFamilyIndex = device_.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  std::vector<const char*> extensions = {VK_KHR_SWAPCHAIN_EXTENSION_NAME};
  STGS_ASSIGN(const player::VulkanSupport offered,
              player::vulkan_support(nullptr, device_.instance, device_.api_version,
                                     device_.physical_device));
  features_ = structure<VkPhysicalDeviceFeatures2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2);
  if (offered.subgroup_size_control) {
    sizes_ = structure<VkPhysicalDeviceSubgroupSizeControlFeatures>(
        VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES);
    sizes_.subgroupSizeControl = sizes_.computeFullSubgroups = VK_TRUE;
    features_.pNext = &sizes_;
    extensions.push_back(VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME);
  }
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
  device_.extensions.assign(extensions.begin(), extensions.end());
  volkLoadDevice(device_.device);
  vkGetDeviceQueue(device_.device, device_.queue_family, 0, &device_.queue);
  return {};
}

}  // namespace stgs::tools
