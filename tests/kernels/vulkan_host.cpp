// SPDX-License-Identifier: Apache-2.0
#include "vulkan_host.h"

#include "stgs/player/vulkan_instance.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace stgs::testing {
namespace {

void check_vulkan(VkResult result, const char* action) {
  if (result == VK_SUCCESS) return;
  std::fprintf(stderr, "%s: VkResult %d\n", action, static_cast<int>(result));
  std::exit(1);
}

}  // namespace

std::vector<std::string>& VulkanHost::messages() {
  static std::vector<std::string> all;
  return all;
}

std::unique_ptr<VulkanHost> VulkanHost::make(bool features) {
  std::unique_ptr<VulkanHost> host(new VulkanHost);
  if (!host->make_instance() || !host->make_device(features)) return nullptr;
  return host;
}

VulkanHost::~VulkanHost() {
  if (device_.device != VK_NULL_HANDLE) {
    vkDeviceWaitIdle(device_.device);
    for (const VkSemaphore one : semaphores_) vkDestroySemaphore(device_.device, one, nullptr);
    for (const HostImage& one : images_) {
      vkDestroyImage(device_.device, one.image, nullptr);
      vkFreeMemory(device_.device, one.memory, nullptr);
    }
    vkDestroyDevice(device_.device, nullptr);
  }
  if (device_.instance == VK_NULL_HANDLE) return;
  if (messenger_ != VK_NULL_HANDLE) {
    vkDestroyDebugUtilsMessengerEXT(device_.instance, messenger_, nullptr);
  }
  vkDestroyInstance(device_.instance, nullptr);
}

bool VulkanHost::make_instance() {
  if (volkInitialize() != VK_SUCCESS) return false;
  static const std::function<void(const std::string&)> on_message = [](const std::string& message) {
    messages().push_back(message);
  };
  player::VulkanInstanceSettings settings;
  settings.api_version = device_.api_version = VK_API_VERSION_1_2;
  settings.on_message = &on_message;
  player::VulkanInstance made;
  if (make_vulkan_instance(settings, made) != VK_SUCCESS) return false;
  device_.instance = made.instance;
  messenger_ = made.messenger;
  volkLoadInstance(device_.instance);
  return true;
}

bool VulkanHost::make_device(bool features) {
  std::uint32_t count = 1;
  if (vkEnumeratePhysicalDevices(device_.instance, &count, &device_.physical_device) < 0 ||
      count == 0) {
    return false;
  }
  std::vector<VkQueueFamilyProperties> families(64);
  count = static_cast<std::uint32_t>(families.size());
  vkGetPhysicalDeviceQueueFamilyProperties(device_.physical_device, &count, families.data());
  while (device_.queue_family < count &&
         (families[device_.queue_family].queueFlags & VK_QUEUE_COMPUTE_BIT) == 0) {
    ++device_.queue_family;
  }
  if (device_.queue_family == count) return false;
  const float priority = 1;
  VkDeviceQueueCreateInfo queue{};
  queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue.queueFamilyIndex = device_.queue_family;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  timeline_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES;
  timeline_.timelineSemaphore = features ? VK_TRUE : VK_FALSE;
  const auto offered = player::vulkan_support(nullptr, device_.instance, device_.api_version,
                                              device_.physical_device);
  if (features && offered.ok() && offered->subgroup_size_control) {
    sizes_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES;
    sizes_.subgroupSizeControl = sizes_.computeFullSubgroups = VK_TRUE;
    timeline_.pNext = &sizes_;
    device_.extensions = {VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME};
  }
  features_.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
  features_.pNext = &timeline_;
  VkDeviceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  info.pNext = &features_;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  const char* const extension = VK_EXT_SUBGROUP_SIZE_CONTROL_EXTENSION_NAME;
  info.enabledExtensionCount = static_cast<std::uint32_t>(device_.extensions.size());
  info.ppEnabledExtensionNames = &extension;
  if (vkCreateDevice(device_.physical_device, &info, nullptr, &device_.device) != VK_SUCCESS) {
    device_.device = VK_NULL_HANDLE;
    return false;
  }
  device_.features = &features_;
  volkLoadDevice(device_.device);
  vkGetDeviceQueue(device_.device, device_.queue_family, 0, &device_.queue);
  return true;
}

VkDeviceMemory VulkanHost::allocate(const VkMemoryRequirements& needs,
                                    VkMemoryPropertyFlags properties) {
  VkPhysicalDeviceMemoryProperties all{};
  vkGetPhysicalDeviceMemoryProperties(device_.physical_device, &all);
  VkMemoryAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  info.allocationSize = needs.size;
  while ((needs.memoryTypeBits >> info.memoryTypeIndex & 1u) == 0 ||
         (all.memoryTypes[info.memoryTypeIndex].propertyFlags & properties) != properties) {
    ++info.memoryTypeIndex;
  }
  VkDeviceMemory memory = VK_NULL_HANDLE;
  check_vulkan(vkAllocateMemory(device_.device, &info, nullptr, &memory), "allocating memory");
  return memory;
}

HostImage VulkanHost::make_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                                 std::uint32_t levels, std::uint32_t layers) {
  HostImage made{VK_NULL_HANDLE, VK_NULL_HANDLE, format, width, height};
  VkImageCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO;
  info.imageType = VK_IMAGE_TYPE_2D;
  info.format = format;
  info.extent = {width, height, 1};
  info.mipLevels = levels;
  info.arrayLayers = layers;
  info.samples = VK_SAMPLE_COUNT_1_BIT;
  info.usage = VK_IMAGE_USAGE_TRANSFER_DST_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT;
  check_vulkan(vkCreateImage(device_.device, &info, nullptr, &made.image), "creating an image");
  VkMemoryRequirements needs{};
  vkGetImageMemoryRequirements(device_.device, made.image, &needs);
  made.memory = allocate(needs, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
  check_vulkan(vkBindImageMemory(device_.device, made.image, made.memory, 0), "binding memory");
  images_.push_back(made);
  return made;
}

std::vector<std::uint8_t> VulkanHost::read(const HostImage& image, VkImageLayout layout,
                                           std::uint32_t pixel_bytes, std::uint32_t level,
                                           std::uint32_t layer) {
  const VkExtent3D extent{image.width >> level, image.height >> level, 1};
  const VkDeviceSize bytes = VkDeviceSize{pixel_bytes} * extent.width * extent.height;
  VkBufferCreateInfo buffer_info{};
  buffer_info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  buffer_info.size = bytes;
  buffer_info.usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  VkBuffer buffer = VK_NULL_HANDLE;
  check_vulkan(vkCreateBuffer(device_.device, &buffer_info, nullptr, &buffer), "creating a buffer");
  VkMemoryRequirements needs{};
  vkGetBufferMemoryRequirements(device_.device, buffer, &needs);
  const VkDeviceMemory memory =
      allocate(needs, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
  check_vulkan(vkBindBufferMemory(device_.device, buffer, memory, 0), "binding memory");
  VkCommandPoolCreateInfo pool_info{};
  pool_info.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  pool_info.queueFamilyIndex = device_.queue_family;
  VkCommandPool pool = VK_NULL_HANDLE;
  check_vulkan(vkCreateCommandPool(device_.device, &pool_info, nullptr, &pool), "creating a pool");
  VkCommandBufferAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  info.commandPool = pool;
  info.commandBufferCount = 1;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  check_vulkan(vkAllocateCommandBuffers(device_.device, &info, &commands), "creating commands");
  VkCommandBufferBeginInfo begin{};
  begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  check_vulkan(vkBeginCommandBuffer(commands, &begin), "beginning commands");
  // Passes the stated layout, so that the validation layer checks it.
  VkImageMemoryBarrier change{};
  change.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER;
  change.srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT;
  change.dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT;
  change.oldLayout = layout;
  change.newLayout = layout;
  change.image = image.image;
  change.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, level, 1, layer, 1};
  vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT,
                       0, 0, nullptr, 0, nullptr, 1, &change);
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, level, layer, 1};
  region.imageExtent = extent;
  vkCmdCopyImageToBuffer(commands, image.image, layout, buffer, 1, &region);
  check_vulkan(vkEndCommandBuffer(commands), "ending commands");
  VkSubmitInfo submit{};
  submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  check_vulkan(vkQueueSubmit(device_.queue, 1, &submit, VK_NULL_HANDLE), "starting commands");
  check_vulkan(vkQueueWaitIdle(device_.queue), "waiting");
  void* mapped = nullptr;
  check_vulkan(vkMapMemory(device_.device, memory, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping memory");
  const auto* from = static_cast<const std::uint8_t*>(mapped);
  std::vector<std::uint8_t> out(from, from + bytes);
  vkDestroyCommandPool(device_.device, pool, nullptr);
  vkDestroyBuffer(device_.device, buffer, nullptr);
  vkFreeMemory(device_.device, memory, nullptr);
  return out;
}

VkSemaphore VulkanHost::make_timeline(std::uint64_t value) {
  VkSemaphoreTypeCreateInfo type{};
  type.sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO;
  type.semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE;
  type.initialValue = value;
  VkSemaphoreCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO;
  info.pNext = &type;
  VkSemaphore semaphore = VK_NULL_HANDLE;
  check_vulkan(vkCreateSemaphore(device_.device, &info, nullptr, &semaphore),
               "creating a semaphore");
  semaphores_.push_back(semaphore);
  return semaphore;
}

void VulkanHost::signal(VkSemaphore semaphore, std::uint64_t value) {
  VkSemaphoreSignalInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SEMAPHORE_SIGNAL_INFO;
  info.semaphore = semaphore;
  info.value = value;
  check_vulkan(vkSignalSemaphore(device_.device, &info), "signalling");
}

std::uint64_t VulkanHost::value_of(VkSemaphore semaphore) {
  std::uint64_t value = 0;
  check_vulkan(vkGetSemaphoreCounterValue(device_.device, semaphore, &value),
               "reading a semaphore");
  return value;
}

}  // namespace stgs::testing
