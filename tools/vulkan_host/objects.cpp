// SPDX-License-Identifier: Apache-2.0
#include "vulkan_host/objects.h"

#include <algorithm>
#include <vector>

namespace stgs::tools {
namespace {

// Allocates device memory with `properties`. kRuntime if none is left.
Status allocate(const DeviceHandles& device, const VkMemoryRequirements& needs,
                VkMemoryPropertyFlags properties, VkDeviceMemory* memory) {
  VkPhysicalDeviceMemoryProperties all{};
  vkGetPhysicalDeviceMemoryProperties(device.physical_device, &all);
  auto info = structure<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO);
  info.allocationSize = needs.size;
  for (std::uint32_t i = 0; i < all.memoryTypeCount; ++i) {
    if ((needs.memoryTypeBits >> i & 1u) == 0) continue;
    if ((all.memoryTypes[i].propertyFlags & properties) != properties) continue;
    info.memoryTypeIndex = i;
    if (vkAllocateMemory(device.device, &info, nullptr, memory) == VK_SUCCESS) return {};
    *memory = VK_NULL_HANDLE;
  }
  return runtime_error("cannot allocate {} KiB of GPU memory", (needs.size >> 10) + 1);
}

}  // namespace

void MappedBuffer::reset() {
  if (device_ == VK_NULL_HANDLE) return;
  vkDestroyBuffer(device_, buffer_, nullptr);
  vkFreeMemory(device_, memory_, nullptr);
  buffer_ = VK_NULL_HANDLE;
  memory_ = VK_NULL_HANDLE;
  bytes_ = 0;
  data_ = nullptr;
}

Status MappedBuffer::ensure(const DeviceHandles& device, VkBufferUsageFlags usage,
                            std::uint64_t bytes) {
  if (bytes <= bytes_) return {};
  reset();
  device_ = device.device;
  bytes = std::max<std::uint64_t>(bytes + bytes / 2, 4096);
  auto info = structure<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO);
  info.size = bytes;
  info.usage = usage;
  STGS_TRY(vk_status(vkCreateBuffer(device_, &info, nullptr, &buffer_), "creating a buffer"));
  VkMemoryRequirements needs{};
  vkGetBufferMemoryRequirements(device_, buffer_, &needs);
  STGS_TRY(allocate(device, needs,
                    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                    &memory_));
  STGS_TRY(vk_status(vkBindBufferMemory(device_, buffer_, memory_, 0), "binding memory"));
  void* mapped = nullptr;
  STGS_TRY(
      vk_status(vkMapMemory(device_, memory_, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping memory"));
  data_ = static_cast<std::uint8_t*>(mapped);
  bytes_ = bytes;
  return {};
}

DeviceImage::~DeviceImage() {
  if (device_ == VK_NULL_HANDLE) return;
  vkDestroyImage(device_, image_, nullptr);
  vkFreeMemory(device_, memory_, nullptr);
}

Status DeviceImage::create(const DeviceHandles& device, const ImageShape& shape,
                           VkImageUsageFlags usage) {
  device_ = device.device;
  auto info = structure<VkImageCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO);
  info.imageType = VK_IMAGE_TYPE_2D;
  info.format = shape.format;
  info.extent = {shape.width, shape.height, 1};
  info.mipLevels = shape.levels;
  info.arrayLayers = shape.layers;
  info.samples = VK_SAMPLE_COUNT_1_BIT;
  info.usage = usage;
  STGS_TRY(vk_status(vkCreateImage(device_, &info, nullptr, &image_), "creating an image"));
  VkMemoryRequirements needs{};
  vkGetImageMemoryRequirements(device_, image_, &needs);
  STGS_TRY(allocate(device, needs, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, &memory_));
  return vk_status(vkBindImageMemory(device_, image_, memory_, 0), "binding memory");
}

VkImageMemoryBarrier image_barrier(VkImage image, std::uint32_t level, std::uint32_t layer) {
  auto barrier = structure<VkImageMemoryBarrier>(VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER);
  barrier.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  barrier.image = image;
  barrier.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, level, 1, layer, 1};
  return barrier;
}

VkBufferImageCopy whole_image(std::uint32_t width, std::uint32_t height) {
  VkBufferImageCopy region{};
  region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
  region.imageExtent = {width, height, 1};
  return region;
}

Status make_view(VkDevice device, VkImage image, VkFormat format, VkImageView* view) {
  auto info = structure<VkImageViewCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO);
  info.image = image;
  info.viewType = VK_IMAGE_VIEW_TYPE_2D;
  info.format = format;
  info.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  return vk_status(vkCreateImageView(device, &info, nullptr, view), "creating an image view");
}

DescriptorSet::~DescriptorSet() {
  if (device_ == VK_NULL_HANDLE) return;
  vkDestroyDescriptorPool(device_, pool_, nullptr);
  vkDestroyDescriptorSetLayout(device_, layout_, nullptr);
}

Status DescriptorSet::create(VkDevice device,
                             std::span<const VkDescriptorSetLayoutBinding> bindings) {
  device_ = device;
  auto layout = structure<VkDescriptorSetLayoutCreateInfo>(
      VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO);
  layout.bindingCount = static_cast<std::uint32_t>(bindings.size());
  layout.pBindings = bindings.data();
  STGS_TRY(vk_status(vkCreateDescriptorSetLayout(device_, &layout, nullptr, &layout_),
                     "creating a descriptor layout"));
  std::vector<VkDescriptorPoolSize> sizes;
  for (const auto& one : bindings) sizes.push_back({one.descriptorType, one.descriptorCount});
  auto pool = structure<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
  pool.maxSets = 1;
  pool.poolSizeCount = static_cast<std::uint32_t>(sizes.size());
  pool.pPoolSizes = sizes.data();
  STGS_TRY(vk_status(vkCreateDescriptorPool(device_, &pool, nullptr, &pool_),
                     "creating a descriptor pool"));
  auto info =
      structure<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
  info.descriptorPool = pool_;
  info.descriptorSetCount = 1;
  info.pSetLayouts = &layout_;
  return vk_status(vkAllocateDescriptorSets(device_, &info, &set_), "allocating a descriptor set");
}

void DescriptorSet::write(const VkDescriptorSetLayoutBinding& binding,
                          const VkDescriptorImageInfo* image,
                          const VkDescriptorBufferInfo* buffer) const {
  auto write = structure<VkWriteDescriptorSet>(VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET);
  write.dstSet = set_;
  write.dstBinding = binding.binding;
  write.descriptorCount = 1;
  write.descriptorType = binding.descriptorType;
  write.pImageInfo = image;
  write.pBufferInfo = buffer;
  vkUpdateDescriptorSets(device_, 1, &write, 0, nullptr);
}

Status make_pipeline_layout(VkDevice device, const DescriptorSet& set,
                            std::span<const VkPushConstantRange> push, VkPipelineLayout* layout) {
  auto info = structure<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
  info.setLayoutCount = 1;
  info.pSetLayouts = &set.layout();
  info.pushConstantRangeCount = static_cast<std::uint32_t>(push.size());
  info.pPushConstantRanges = push.data();
  return vk_status(vkCreatePipelineLayout(device, &info, nullptr, layout),
                   "creating a pipeline layout");
}

Result<VkShaderModule> make_shader(VkDevice device, std::span<const std::uint32_t> code) {
  auto info = structure<VkShaderModuleCreateInfo>(VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
  info.codeSize = code.size_bytes();
  info.pCode = code.data();
  VkShaderModule module = VK_NULL_HANDLE;
  STGS_TRY(vk_status(vkCreateShaderModule(device, &info, nullptr, &module), "loading a shader"));
  return module;
}

VkPipelineShaderStageCreateInfo stage_of(VkShaderStageFlagBits stage, VkShaderModule module) {
  auto info = structure<VkPipelineShaderStageCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO);
  info.stage = stage;
  info.module = module;
  info.pName = "main";
  return info;
}

Status make_commands(const DeviceHandles& device, VkCommandPool* pool, VkCommandBuffer* commands) {
  auto pool_info = structure<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  pool_info.queueFamilyIndex = device.queue_family;
  STGS_TRY(vk_status(vkCreateCommandPool(device.device, &pool_info, nullptr, pool),
                     "creating a command pool"));
  auto info =
      structure<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
  info.commandPool = *pool;
  info.commandBufferCount = 1;
  return vk_status(vkAllocateCommandBuffers(device.device, &info, commands),
                   "creating a command buffer");
}

Status begin_commands(VkCommandBuffer commands) {
  auto begin = structure<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  return vk_status(vkBeginCommandBuffer(commands, &begin), "beginning a command buffer");
}

Status run_commands(const DeviceHandles& device,
                    const std::function<void(VkCommandBuffer)>& record) {
  VkCommandPool pool = VK_NULL_HANDLE;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  Status status = make_commands(device, &pool, &commands);
  if (status.ok()) status = begin_commands(commands);
  if (status.ok()) {
    record(commands);
    status = vk_status(vkEndCommandBuffer(commands), "ending a command buffer");
  }
  auto submit = structure<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  if (status.ok()) {
    status =
        vk_status(vkQueueSubmit(device.queue, 1, &submit, VK_NULL_HANDLE), "submitting commands");
  }
  if (status.ok()) status = vk_status(vkQueueWaitIdle(device.queue), "waiting for the queue");
  vkDestroyCommandPool(device.device, pool, nullptr);
  return status;
}

}  // namespace stgs::tools
