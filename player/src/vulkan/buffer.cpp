// SPDX-License-Identifier: Apache-2.0
#include "vulkan/buffer.h"

#include <algorithm>

namespace stgs::player::vulkan {

Buffer& Buffer::operator=(Buffer&& other) noexcept {
  if (this == &other) return *this;
  reset();
  device_ = other.device_;
  buffer_ = std::exchange(other.buffer_, VkBuffer{VK_NULL_HANDLE});
  memory_ = std::exchange(other.memory_, VkDeviceMemory{VK_NULL_HANDLE});
  bytes_ = std::exchange(other.bytes_, 0);
  charged_ = std::exchange(other.charged_, 0);
  mapped_ = std::exchange(other.mapped_, nullptr);
  return *this;
}

void Buffer::reset() {
  if (device_ == nullptr) return;
  device_->vk.vkDestroyBuffer(device_->handle(), buffer_, nullptr);
  device_->vk.vkFreeMemory(device_->handle(), memory_, nullptr);
  if (charged_ > 0) device_->renderer_memory->release(std::exchange(charged_, 0));
  buffer_ = VK_NULL_HANDLE;
  memory_ = VK_NULL_HANDLE;
  bytes_ = 0;
  mapped_ = nullptr;
}

Status Buffer::create(const Device& device, std::uint64_t bytes, MemoryLocation location) {
  reset();
  device_ = &device;
  if (device.renderer_memory != nullptr && location != MemoryLocation::kSegments) {
    STGS_TRY(device.renderer_memory->charge(bytes));
    charged_ = bytes;
  }
  auto info = structure<VkBufferCreateInfo>(VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO);
  info.size = bytes;
  info.usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  if (location != MemoryLocation::kHost) {
    info.usage |= VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT;
  }
  const auto& vk = device.vk;
  STGS_TRY(
      vk_status(vk.vkCreateBuffer(device.handle(), &info, nullptr, &buffer_), "creating a buffer"));
  VkMemoryRequirements needs{};
  vk.vkGetBufferMemoryRequirements(device.handle(), buffer_, &needs);
  const VkMemoryPropertyFlags properties =
      location != MemoryLocation::kHost
          ? VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT
          : VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
  Status status;
  if (location == MemoryLocation::kHost) {
    // Prefer cached memory: it is many times faster for reads by the host.
    status = device.allocate(needs, properties | VK_MEMORY_PROPERTY_HOST_CACHED_BIT, &memory_);
  }
  if (memory_ == VK_NULL_HANDLE) status = device.allocate(needs, properties, &memory_);
  STGS_TRY(status);
  STGS_TRY(vk_status(vk.vkBindBufferMemory(device.handle(), buffer_, memory_, 0),
                     "binding buffer memory"));
  if (location == MemoryLocation::kHost) {
    STGS_TRY(vk_status(vk.vkMapMemory(device.handle(), memory_, 0, VK_WHOLE_SIZE, 0, &mapped_),
                       "mapping buffer memory"));
  }
  bytes_ = bytes;
  return {};
}

Status Buffer::ensure(const Device& device, std::uint64_t bytes, MemoryLocation location,
                      std::uint64_t max_bytes) {
  if (bytes <= bytes_) return {};
  const std::uint64_t target = std::max(bytes, std::min(bytes + bytes / 4, max_bytes));
  const auto create_padded = [&](std::uint64_t wanted) {
    return create(device, (wanted + 15) / 16 * 16, location);
  };
  const Status status = create_padded(target);
  return status.code() == StatusCode::kLimit ? create_padded(bytes) : status;
}

namespace {

void memory_barrier(const Device& device, VkCommandBuffer commands, VkPipelineStageFlags before,
                    VkAccessFlags written, VkPipelineStageFlags after, VkAccessFlags used) {
  auto memory = structure<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  memory.srcAccessMask = written;
  memory.dstAccessMask = used;
  device.vk.vkCmdPipelineBarrier(commands, before, after, 0, 1, &memory, 0, nullptr, 0, nullptr);
}

}  // namespace

void barrier(const Device& device, VkCommandBuffer commands) {
  memory_barrier(
      device, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
      VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT,
      VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT |
          VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT | VK_PIPELINE_STAGE_HOST_BIT,
      VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_INDIRECT_COMMAND_READ_BIT |
          VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT | VK_ACCESS_HOST_READ_BIT);
}

void shader_barrier(const Device& device, VkCommandBuffer commands) {
  memory_barrier(
      device, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
      VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_DRAW_INDIRECT_BIT,
      VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_INDIRECT_COMMAND_READ_BIT);
}

}  // namespace stgs::player::vulkan
