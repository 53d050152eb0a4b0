// SPDX-License-Identifier: Apache-2.0
#include "play/window_device.h"

#include <GLFW/glfw3.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "session.h"

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
  return find_queue_family(
      device, VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT, [&](std::uint32_t family) {
        VkBool32 presents = VK_FALSE;
        return vkGetPhysicalDeviceSurfaceSupportKHR(device, family, surface, &presents) ==
                   VK_SUCCESS &&
               presents == VK_TRUE;
      });
}

}  // namespace

Result<std::unique_ptr<WindowDevice>> WindowDevice::make(
    GLFWwindow* window, std::function<void(const std::string&)> on_message) {
  std::unique_ptr<WindowDevice> made(new WindowDevice);
  made->on_message_ = std::move(on_message);
  STGS_TRY(made->make_instance());
  STGS_TRY(
      vk_status(glfwCreateWindowSurface(made->device().instance, window, nullptr, &made->surface_),
                "creating a window surface"));
  STGS_TRY(made->open());
  return made;
}

WindowDevice::~WindowDevice() {
  host_.close();
  if (device().instance != VK_NULL_HANDLE) {
    vkDestroySurfaceKHR(device().instance, surface_, nullptr);
  }
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
  settings.extensions.assign(needed, needed + count);
  if (on_message_ != nullptr) settings.on_message = &on_message_;
  const VkResult result = host_.make_instance(settings);
  if (result != VK_SUCCESS) {
    return unsupported("cannot create a Vulkan instance (VkResult {})", static_cast<int>(result));
  }
  return {};
}

Status WindowDevice::open() {
  STGS_ASSIGN(const std::vector<VkPhysicalDevice> devices, physical_devices(device().instance));
  HostDevice::Request request;
  int best = 0;
  for (const VkPhysicalDevice candidate : devices) {
    const int family = family_of(candidate, surface_);
    VkPhysicalDeviceProperties properties{};
    vkGetPhysicalDeviceProperties(candidate, &properties);
    const int rank = player::vulkan_device_rank(properties.deviceType);
    if (family < 0 || rank <= best) continue;
    STGS_ASSIGN(
        const player::VulkanSupport offered,
        player::vulkan_support(nullptr, device().instance, device().api_version, candidate));
    if (!offered.missing_features.empty()) continue;
    best = rank;
    request.physical_device = candidate;
    request.queue_family = static_cast<std::uint32_t>(family);
    name_ = properties.deviceName;
  }
  if (best == 0) {
    return unsupported("no Vulkan device can render to this window ({} found); use 'stgs render'",
                       plural(std::ssize(devices), "device"));
  }
  request.extensions = {VK_KHR_SWAPCHAIN_EXTENSION_NAME};
  request.subgroup_size_control = true;
  return host_.open(request);
}

}  // namespace stgs::tools
