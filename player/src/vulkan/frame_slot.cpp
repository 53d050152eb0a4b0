// SPDX-License-Identifier: Apache-2.0
#include "vulkan/frame_slot.h"

#include <cstring>
#include <vector>

namespace stgs::player::vulkan {
namespace {

// Semaphores in the layout of VkSubmitInfo.
struct Semaphores {
  explicit Semaphores(std::span<const VulkanSemaphore> from) {
    for (const VulkanSemaphore& one : from) {
      handles.push_back(one.semaphore);
      values.push_back(one.value);
      timeline = timeline || one.value > 0;
    }
  }
  std::uint32_t count() const { return static_cast<std::uint32_t>(handles.size()); }

  std::vector<VkSemaphore> handles;
  std::vector<std::uint64_t> values;
  bool timeline = false;
};

}  // namespace

FrameSlot::~FrameSlot() {
  if (device_ == nullptr) return;
  if (in_flight_) (void)device_->wait(fence_);
  const auto& vk = device_->vk;
  vk.vkDestroyFence(device_->handle(), fence_, nullptr);
  vk.vkDestroyCommandPool(device_->handle(), pool_, nullptr);
}

Status FrameSlot::create(Device& device) {
  device_ = &device;
  const auto& vk = device.vk;
  auto pool = structure<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  pool.queueFamilyIndex = device.family();
  STGS_TRY(vk_status(vk.vkCreateCommandPool(device.handle(), &pool, nullptr, &pool_),
                     "creating a command pool"));
  auto info =
      structure<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
  info.commandPool = pool_;
  info.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  info.commandBufferCount = static_cast<std::uint32_t>(commands_.size());
  STGS_TRY(vk_status(vk.vkAllocateCommandBuffers(device.handle(), &info, commands_.data()),
                     "allocating command buffers"));
  const auto fence = structure<VkFenceCreateInfo>(VK_STRUCTURE_TYPE_FENCE_CREATE_INFO);
  STGS_TRY(
      vk_status(vk.vkCreateFence(device.handle(), &fence, nullptr, &fence_), "creating a fence"));
  STGS_TRY(counts_.create(device, sizeof(Counts), MemoryLocation::kHost));
  return device.timestamp_ns() == 0 ? Status() : timestamps_.create(device, kStageTimestamps);
}

Result<bool> FrameSlot::has_completed() {
  if (!in_flight_) return true;
  const VkResult result = device_->vk.vkGetFenceStatus(device_->handle(), fence_);
  if (result == VK_NOT_READY) return false;
  STGS_TRY(vk_status(result, "querying a fence"));
  in_flight_ = false;
  return true;
}

Status FrameSlot::wait() {
  if (!in_flight_) return {};
  STGS_TRY(device_->wait(fence_));
  in_flight_ = false;
  return {};
}

Status FrameSlot::begin() {
  STGS_TRY(vk_status(device_->vk.vkResetCommandPool(device_->handle(), pool_, 0),
                     "resetting a command pool"));
  for (const VkCommandBuffer commands : commands_) {
    auto info = structure<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
    info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    STGS_TRY(
        vk_status(device_->vk.vkBeginCommandBuffer(commands, &info), "beginning a command buffer"));
  }
  // Frames share working buffers: this one waits for those before it.
  barrier(*device_, draw());
  return {};
}

Status FrameSlot::submit(std::span<const VulkanSemaphore> wait,
                         std::span<const VulkanSemaphore> signal) {
  for (const VkCommandBuffer commands : commands_) {
    STGS_TRY(vk_status(device_->vk.vkEndCommandBuffer(commands), "ending a command buffer"));
  }
  const Semaphores before(wait), after(signal);
  const std::vector<VkPipelineStageFlags> stages(wait.size(), VK_PIPELINE_STAGE_ALL_COMMANDS_BIT);
  auto values =
      structure<VkTimelineSemaphoreSubmitInfo>(VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO);
  values.waitSemaphoreValueCount = before.count();
  values.pWaitSemaphoreValues = before.values.data();
  values.signalSemaphoreValueCount = after.count();
  values.pSignalSemaphoreValues = after.values.data();
  // Two batches, so that rendering does not wait for the caller's images.
  std::array<VkSubmitInfo, 2> batches{};
  for (std::size_t i = 0; i < batches.size(); ++i) {
    batches[i].sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
    batches[i].commandBufferCount = 1;
    batches[i].pCommandBuffers = &commands_[i];
  }
  VkSubmitInfo& last = batches[1];
  if (before.timeline || after.timeline) last.pNext = &values;
  last.waitSemaphoreCount = before.count();
  last.pWaitSemaphores = before.handles.data();
  last.pWaitDstStageMask = stages.data();
  last.signalSemaphoreCount = after.count();
  last.pSignalSemaphores = after.handles.data();
  STGS_TRY(device_->submit(batches, fence_));
  in_flight_ = true;
  return {};
}

Counts FrameSlot::counts() const {
  Counts counts{};
  std::memcpy(&counts, counts_.mapped(), sizeof(counts));
  return counts;
}

Status FrameSlot::add_times(RenderStats& to) const {
  if (timestamps() == VK_NULL_HANDLE) return {};
  std::array<double, kStageTimestamps - 1> ms{};
  STGS_TRY(timestamps_.between(ms));
  to.slice_ms += ms[0];
  to.bin_ms += ms[1];
  to.blend_ms += ms[2];
  to.device_ms += ms[0] + ms[1] + ms[2];
  return {};
}

}  // namespace stgs::player::vulkan
