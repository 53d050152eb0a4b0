// SPDX-License-Identifier: Apache-2.0
// What a frame has for itself while it is on its way: its commands, and what the device tells when
// it has ended.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "stgs/player/vulkan_renderer.h"
#include "vulkan/buffer.h"
#include "vulkan/frame_buffers.h"
#include "vulkan/frame_commands.h"
#include "vulkan/times.h"

namespace stgs::player::vulkan {

// One thread; the device outlives it. The destructor waits.
class FrameSlot {
 public:
  FrameSlot() = default;
  FrameSlot(const FrameSlot&) = delete;
  FrameSlot& operator=(const FrameSlot&) = delete;
  ~FrameSlot();

  Status create(Device& device);
  // Whether its last frame has not ended as far as is known.
  bool on_its_way() const { return on_its_way_; }
  Result<bool> has_ended();  // looks
  Status wait();

  // Begins a frame; the last one has ended. `draw` is for drawing, `hand_over` for what waits for
  // the caller's semaphores.
  Status begin();
  VkCommandBuffer draw() const { return commands_[0]; }
  VkCommandBuffer hand_over() const { return commands_[1]; }
  FrameCommands& sets() { return sets_; }
  VkBuffer told() const { return told_.handle(); }
  VkQueryPool times() const { return times_.pool(); }
  // Starts both.
  Status submit(std::span<const VulkanSemaphore> wait, std::span<const VulkanSemaphore> signal);

  // Of a frame that has ended.
  Counts counts() const;
  Status add_times(RenderStats& stats) const;

  std::uint64_t number = 0;    // of the frame, as all that follows
  std::uint64_t capacity = 0;  // instances that there was room for
  RenderStats stats;           // what the host knows of it
  std::vector<Buffer> copied;  // that its commands copy from

 private:
  Device* device_ = nullptr;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  std::array<VkCommandBuffer, 2> commands_{};
  VkFence fence_ = VK_NULL_HANDLE;
  Times times_;
  FrameCommands sets_;
  Buffer told_;
  bool on_its_way_ = false;
};

}  // namespace stgs::player::vulkan
