// SPDX-License-Identifier: Apache-2.0
#include "play/window_device.h"

#include <GLFW/glfw3.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "scene_file.h"

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
  InstanceSettings settings;
  settings.application = "stgs play";
  settings.extensions.assign(needed, needed + count);
  if (on_message_ != nullptr) settings.on_message = &on_message_;
  const VkResult result = host_.make_instance(settings);
  if (result != VK_SUCCESS) {
    return unsupported("cannot create a Vulkan instance (VkResult {})", static_cast<int>(result));
  }
  return {};
}

Result<stgs_vulkan_device> WindowDevice::lent() const {
  stgs_vulkan_device lent;
  if (stgs_vulkan_device_defaults(&lent, sizeof(lent)) != STGS_OK) {
    return runtime_error("the library is older than the program");
  }
  lent.instance = device().instance;
  lent.api_version = device().api_version;
  lent.physical_device = device().physical_device;
  lent.device = device().device;
  lent.queue = device().queue;
  lent.queue_family = device().queue_family;
  lent.subgroup_size_control = subgroup_size_control_ ? 1 : 0;
  return lent;
}

Result<stgs_vulkan_support> WindowDevice::support_of(VkPhysicalDevice candidate) const {
  STGS_ASSIGN(stgs_vulkan_device queried, lent());
  queried.physical_device = candidate;
  auto support = sized<stgs_vulkan_support>();
  const stgs_result result = stgs_vulkan_get_support(&queried, &support);
  if (result == STGS_OK) return support;
  return unsupported("cannot query a Vulkan device: {}", stgs_result_name(result));
}

Status WindowDevice::open() {
  STGS_ASSIGN(const std::vector<VkPhysicalDevice> devices, physical_devices(device().instance));
  HostDevice::Request request;
  std::int32_t best = 0;
  for (const VkPhysicalDevice candidate : devices) {
    const int family = family_of(candidate, surface_);
    if (family < 0) continue;
    STGS_ASSIGN(const stgs_vulkan_support support, support_of(candidate));
    if (support.device_rank <= best) continue;
    best = support.device_rank;
    request.physical_device = candidate;
    request.queue_family = static_cast<std::uint32_t>(family);
    request.subgroup_size_control = support.subgroup_size_control != 0;
    VkPhysicalDeviceProperties properties{};
    vkGetPhysicalDeviceProperties(candidate, &properties);
    name_ = properties.deviceName;
  }
  if (best == 0) {
    return unsupported("no Vulkan device can render to this window ({} found); use 'stgs render'",
                       plural(std::ssize(devices), "device"));
  }
  request.extensions = {VK_KHR_SWAPCHAIN_EXTENSION_NAME};
  subgroup_size_control_ = request.subgroup_size_control;
  return host_.open(request);
}

}  // namespace stgs::tools
