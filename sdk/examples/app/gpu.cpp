// SPDX-License-Identifier: Apache-2.0
#include "gpu.h"

#define STB_IMAGE_WRITE_IMPLEMENTATION
#include <stb_image_write.h>

#include <algorithm>
#include <utility>

namespace app {
namespace {

// Whether the application and STGS can share a queue of the family.
bool is_suitable(const VkQueueFamilyProperties& family) {
  constexpr VkQueueFlags kBoth = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
  return (family.queueFlags & kBoth) == kBoth;
}

// Returns a suitable queue family; -1: none.
int family_of(VkPhysicalDevice device) {
  std::uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families.data());
  for (std::uint32_t i = 0; i < count; ++i) {
    if (is_suitable(families[i])) return static_cast<int>(i);
  }
  return -1;
}

int rank_of(VkPhysicalDevice device) {
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(device, &properties);
  if (properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU) return 2;
  return properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU ? 0 : 1;
}

// Returns the feature that the example or STGS misses; empty if the device is suitable.
std::string missing_feature(const Gpu& gpu) {
  VkPhysicalDeviceProperties properties{};
  vkGetPhysicalDeviceProperties(gpu.physical_device, &properties);
  if (properties.apiVersion < VK_API_VERSION_1_3) return "Vulkan 1.3";
  if (family_of(gpu.physical_device) < 0) return "queue for graphics and compute";
  const stgs_vulkan_device device = gpu.stgs_device();
  stgs_vulkan_support support{};
  support.struct_size = sizeof support;
  if (stgs_vulkan_get_support(&device, &support) != STGS_OK) return "Vulkan support in STGS";
  return support.missing_features;
}

}  // namespace

void check(VkResult result, const char* operation) {
  if (result == VK_SUCCESS) return;
  throw std::runtime_error(std::string(operation) + ": VkResult " + std::to_string(result));
}

void check(stgs_result result, stgs_renderer* renderer) {
  if (result == STGS_OK) return;
  stgs_error error{};
  error.struct_size = sizeof error;
  stgs_renderer_error(renderer, &error);
  throw std::runtime_error(error.message);
}

void check(stgs_result result, stgs_scene* scene) {
  if (result == STGS_OK) return;
  stgs_error error{};
  error.struct_size = sizeof error;
  stgs_scene_error(scene, &error);
  throw std::runtime_error(error.message);
}

void check(stgs_result result, stgs_player* player) {
  if (result == STGS_OK) return;
  stgs_error error{};
  error.struct_size = sizeof error;
  stgs_player_error(player, &error);
  throw std::runtime_error(error.message);
}

DeviceFactory vulkan_factory() {
  return {[](const VkInstanceCreateInfo& info, VkInstance* out) {
            return vkCreateInstance(&info, nullptr, out);
          },
          nullptr,
          [](VkPhysicalDevice from, const VkDeviceCreateInfo& info, VkDevice* out) {
            return vkCreateDevice(from, &info, nullptr, out);
          }};
}

Gpu::Gpu(const DeviceFactory& factory) : Gpu() {
  VkApplicationInfo application{};
  application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
  application.pApplicationName = "STGS example";
  application.apiVersion = VK_API_VERSION_1_3;
  VkInstanceCreateInfo instance_info{};
  instance_info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  instance_info.pApplicationInfo = &application;
  if (factory.create_instance(instance_info, &instance) != VK_SUCCESS) {
    throw Unsupported("Vulkan 1.3 is not available");
  }
  choose(factory);
  queue_family = static_cast<std::uint32_t>(family_of(physical_device));
  const float priority = 1;
  VkDeviceQueueCreateInfo queue_info{};
  queue_info.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue_info.queueFamilyIndex = queue_family;
  queue_info.queueCount = 1;
  queue_info.pQueuePriorities = &priority;
  // STGS requires none of these features. The example synchronises with timeline semaphores, and
  // subgroup size control, part of Vulkan 1.3, makes some GPUs faster. Each feature has its own
  // struct because an OpenXR runtime may chain others, which the structs of a Vulkan version would
  // exclude.
  VkPhysicalDeviceSubgroupSizeControlFeatures sizes{};
  sizes.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_SIZE_CONTROL_FEATURES;
  sizes.subgroupSizeControl = sizes.computeFullSubgroups = VK_TRUE;
  VkPhysicalDeviceDynamicRenderingFeatures rendering{};
  rendering.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DYNAMIC_RENDERING_FEATURES;
  rendering.pNext = &sizes;
  rendering.dynamicRendering = VK_TRUE;
  VkPhysicalDeviceSynchronization2Features synchronisation{};
  synchronisation.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SYNCHRONIZATION_2_FEATURES;
  synchronisation.pNext = &rendering;
  synchronisation.synchronization2 = VK_TRUE;
  VkPhysicalDeviceTimelineSemaphoreFeatures timeline{};
  timeline.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_TIMELINE_SEMAPHORE_FEATURES;
  timeline.pNext = &synchronisation;
  timeline.timelineSemaphore = VK_TRUE;
  VkDeviceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  info.pNext = &timeline;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue_info;
  check(factory.create_device(physical_device, info, &device), "creating a device");
  vkGetDeviceQueue(device, queue_family, 0, &queue);
  VkCommandPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  pool.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
  pool.queueFamilyIndex = queue_family;
  check(vkCreateCommandPool(device, &pool, nullptr, &pool_), "creating a command pool");
}

Gpu::~Gpu() {
  if (device != VK_NULL_HANDLE) {
    vkDeviceWaitIdle(device);
    while (!cleanups_.empty()) {
      cleanups_.back()();
      cleanups_.pop_back();
    }
    vkDestroyCommandPool(device, pool_, nullptr);
    vkDestroyDevice(device, nullptr);
  }
  if (instance != VK_NULL_HANDLE) vkDestroyInstance(instance, nullptr);
}

void Gpu::choose(const DeviceFactory& factory) {
  std::vector<VkPhysicalDevice> devices;
  if (factory.choose_device) {
    devices.push_back(factory.choose_device(instance));
  } else {
    std::uint32_t count = 0;
    vkEnumeratePhysicalDevices(instance, &count, nullptr);
    devices.resize(count);
    check(vkEnumeratePhysicalDevices(instance, &count, devices.data()), "listing devices");
  }
  // Discrete GPUs first, CPU implementations last.
  std::stable_sort(devices.begin(), devices.end(),
                   [](VkPhysicalDevice a, VkPhysicalDevice b) { return rank_of(a) > rank_of(b); });
  std::string missing = "device";
  for (const VkPhysicalDevice one : devices) {
    physical_device = one;
    missing = missing_feature(*this);
    if (missing.empty()) return;
  }
  throw Unsupported("no suitable Vulkan device (missing: " + missing + ")");
}

stgs_vulkan_device Gpu::stgs_device() const {
  stgs_vulkan_device out;
  stgs_vulkan_device_defaults(&out, sizeof out);
  out.instance = instance;
  out.api_version = VK_API_VERSION_1_3;
  out.physical_device = physical_device;
  out.device = device;
  out.queue = queue;
  out.queue_family = queue_family;
  out.timeline_semaphores = out.subgroup_size_control = 1;
  return out;
}

VkDeviceMemory Gpu::allocate(const VkMemoryRequirements& needs, VkMemoryPropertyFlags properties) {
  VkPhysicalDeviceMemoryProperties memory{};
  vkGetPhysicalDeviceMemoryProperties(physical_device, &memory);
  VkMemoryAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  info.allocationSize = needs.size;
  for (std::uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    if ((needs.memoryTypeBits >> i & 1u) == 0) continue;
    if ((memory.memoryTypes[i].propertyFlags & properties) != properties) continue;
    info.memoryTypeIndex = i;
    VkDeviceMemory out = VK_NULL_HANDLE;
    check(vkAllocateMemory(device, &info, nullptr, &out), "allocating GPU memory");
    return out;
  }
  throw std::runtime_error("the GPU has no suitable memory type");
}

Image Gpu::create_image(VkFormat format, std::uint32_t width, std::uint32_t height,
                        VkImageUsageFlags usage, VkImageAspectFlags aspect) {
  VkImageCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO;
  info.imageType = VK_IMAGE_TYPE_2D;
  info.format = format;
  info.extent = {width, height, 1};
  info.mipLevels = info.arrayLayers = 1;
  info.samples = VK_SAMPLE_COUNT_1_BIT;
  info.usage = usage;
  Image out{VK_NULL_HANDLE, VK_NULL_HANDLE, format, width, height};
  check(vkCreateImage(device, &info, nullptr, &out.image), "creating an image");
  defer([this, image = out.image] { vkDestroyImage(device, image, nullptr); });
  VkMemoryRequirements needs{};
  vkGetImageMemoryRequirements(device, out.image, &needs);
  const VkDeviceMemory memory = allocate(needs, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
  // Runs after the destruction of the image.
  cleanups_.insert(cleanups_.end() - 1, [this, memory] { vkFreeMemory(device, memory, nullptr); });
  check(vkBindImageMemory(device, out.image, memory, 0), "binding an image");
  out.view = create_view(out.image, format, aspect);
  defer([this, view = out.view] { vkDestroyImageView(device, view, nullptr); });
  return out;
}

VkImageView Gpu::create_view(VkImage image, VkFormat format, VkImageAspectFlags aspect) const {
  VkImageViewCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO;
  info.image = image;
  info.viewType = VK_IMAGE_VIEW_TYPE_2D;
  info.format = format;
  info.subresourceRange = {aspect, 0, 1, 0, 1};
  VkImageView view = VK_NULL_HANDLE;
  check(vkCreateImageView(device, &info, nullptr, &view), "creating an image view");
  return view;
}

VkSemaphore Gpu::create_timeline() {
  VkSemaphoreTypeCreateInfo type{};
  type.sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO;
  type.semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE;
  VkSemaphoreCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO;
  info.pNext = &type;
  VkSemaphore semaphore = VK_NULL_HANDLE;
  check(vkCreateSemaphore(device, &info, nullptr, &semaphore), "creating a semaphore");
  defer([this, semaphore] { vkDestroySemaphore(device, semaphore, nullptr); });
  return semaphore;
}

VkShaderModule Gpu::create_shader(std::span<const std::uint32_t> code) {
  VkShaderModuleCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
  info.codeSize = code.size_bytes();
  info.pCode = code.data();
  VkShaderModule shader = VK_NULL_HANDLE;
  check(vkCreateShaderModule(device, &info, nullptr, &shader), "creating a shader");
  defer([this, shader] { vkDestroyShaderModule(device, shader, nullptr); });
  return shader;
}

VkCommandBuffer Gpu::allocate_commands() {
  VkCommandBufferAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  info.commandPool = pool_;
  info.commandBufferCount = 1;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  check(vkAllocateCommandBuffers(device, &info, &commands), "creating commands");
  return commands;
}

std::vector<std::uint8_t> Gpu::read(const Image& image, VkImageLayout layout) {
  const VkDeviceSize bytes = VkDeviceSize{4} * image.width * image.height;
  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = bytes;
  info.usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  VkBuffer buffer = VK_NULL_HANDLE;
  check(vkCreateBuffer(device, &info, nullptr, &buffer), "creating a buffer");
  VkMemoryRequirements needs{};
  vkGetBufferMemoryRequirements(device, buffer, &needs);
  const VkDeviceMemory memory =
      allocate(needs, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
  check(vkBindBufferMemory(device, buffer, memory, 0), "binding a buffer");
  VkCommandBuffer commands = allocate_commands();
  VkCommandBufferBeginInfo begin{};
  begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  check(vkBeginCommandBuffer(commands, &begin), "beginning commands");
  constexpr VkImageLayout kSource = VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL;
  change_layout(commands, image.image, layout, kSource);
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
  region.imageExtent = {image.width, image.height, 1};
  vkCmdCopyImageToBuffer(commands, image.image, kSource, buffer, 1, &region);
  change_layout(commands, image.image, kSource, layout);
  check(vkEndCommandBuffer(commands), "ending commands");
  VkSubmitInfo submit{};
  submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  check(vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE), "submitting");
  check(vkQueueWaitIdle(queue), "waiting for the queue");
  void* mapped = nullptr;
  check(vkMapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping a buffer");
  const auto* from = static_cast<const std::uint8_t*>(mapped);
  std::vector<std::uint8_t> out(from, from + bytes);
  if (image.format == VK_FORMAT_B8G8R8A8_UNORM) {
    for (std::size_t i = 0; i < out.size(); i += 4) std::swap(out[i], out[i + 2]);
  }
  vkFreeCommandBuffers(device, pool_, 1, &commands);
  vkDestroyBuffer(device, buffer, nullptr);
  vkFreeMemory(device, memory, nullptr);
  return out;
}

void change_layout(VkCommandBuffer commands, VkImage image, VkImageLayout from, VkImageLayout to,
                   VkImageAspectFlags aspect) {
  VkImageMemoryBarrier2 barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER_2;
  barrier.srcStageMask = barrier.dstStageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT;
  barrier.srcAccessMask = VK_ACCESS_2_MEMORY_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_2_MEMORY_READ_BIT | VK_ACCESS_2_MEMORY_WRITE_BIT;
  barrier.oldLayout = from;
  barrier.newLayout = to;
  barrier.srcQueueFamilyIndex = barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image;
  barrier.subresourceRange = {aspect, 0, 1, 0, 1};
  VkDependencyInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DEPENDENCY_INFO;
  info.imageMemoryBarrierCount = 1;
  info.pImageMemoryBarriers = &barrier;
  vkCmdPipelineBarrier2(commands, &info);
}

void write_png(const std::string& path, std::uint32_t width, std::uint32_t height,
               std::vector<std::uint8_t> pixels) {
  for (std::size_t i = 3; i < pixels.size(); i += 4) pixels[i] = 255;
  const int w = static_cast<int>(width), h = static_cast<int>(height);
  if (stbi_write_png(path.c_str(), w, h, 4, pixels.data(), 4 * w) == 0) {
    throw std::runtime_error(path + ": cannot write the image");
  }
}

}  // namespace app
