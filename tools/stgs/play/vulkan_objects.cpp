// SPDX-License-Identifier: Apache-2.0
#include "play/vulkan_objects.h"

#include <algorithm>

namespace stgs::tools {

Status allocate(VkPhysicalDevice physical, VkDevice device, const VkMemoryRequirements& needs,
                VkMemoryPropertyFlags properties, VkDeviceMemory* memory) {
  VkPhysicalDeviceMemoryProperties all{};
  vkGetPhysicalDeviceMemoryProperties(physical, &all);
  auto info = structure<VkMemoryAllocateInfo>(VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO);
  info.allocationSize = needs.size;
  for (std::uint32_t i = 0; i < all.memoryTypeCount; ++i) {
    if ((needs.memoryTypeBits >> i & 1u) == 0) continue;
    if ((all.memoryTypes[i].propertyFlags & properties) != properties) continue;
    info.memoryTypeIndex = i;
    if (vkAllocateMemory(device, &info, nullptr, memory) == VK_SUCCESS) return {};
    *memory = VK_NULL_HANDLE;
  }
  return runtime_error("cannot allocate {} KiB of GPU memory for the window",
                       (needs.size >> 10) + 1);
}

void MappedBuffer::reset() {
  if (device_ == VK_NULL_HANDLE) return;
  vkDestroyBuffer(device_, buffer_, nullptr);
  vkFreeMemory(device_, memory_, nullptr);
  buffer_ = VK_NULL_HANDLE;
  memory_ = VK_NULL_HANDLE;
  bytes_ = 0;
  data_ = nullptr;
}

Status MappedBuffer::ensure(VkPhysicalDevice physical, VkDevice device, VkBufferUsageFlags usage,
                            std::uint64_t bytes) {
  if (bytes <= bytes_) return {};
  reset();
  device_ = device;
  bytes = std::max<std::uint64_t>(bytes + bytes / 2, 4096);
  auto info = structure<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO);
  info.size = bytes;
  info.usage = usage;
  STGS_TRY(vk_status(vkCreateBuffer(device, &info, nullptr, &buffer_), "creating a buffer"));
  VkMemoryRequirements needs{};
  vkGetBufferMemoryRequirements(device, buffer_, &needs);
  STGS_TRY(allocate(physical, device, needs,
                    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                    &memory_));
  STGS_TRY(vk_status(vkBindBufferMemory(device, buffer_, memory_, 0), "binding memory"));
  void* mapped = nullptr;
  STGS_TRY(vk_status(vkMapMemory(device, memory_, 0, VK_WHOLE_SIZE, 0, &mapped), "mapping memory"));
  data_ = static_cast<std::uint8_t*>(mapped);
  bytes_ = bytes;
  return {};
}

}  // namespace stgs::tools
