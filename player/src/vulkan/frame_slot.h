// SPDX-License-Identifier: Apache-2.0
// The resources of a frame in flight: its commands, and the results that the device returns.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "stgs/player/vulkan_renderer.h"
#include "vulkan/buffer.h"
#include "vulkan/frame_buffers.h"
#include "vulkan/frame_commands.h"
#include "vulkan/timestamps.h"

namespace stgs::player::vulkan {

// One thread. The device outlives it. The destructor waits for the frame.
class FrameSlot {
 public:
  FrameSlot() = default;
  FrameSlot(const FrameSlot&) = delete;
  FrameSlot& operator=(const FrameSlot&) = delete;
  ~FrameSlot();

  Status create(Device& device);
  // Returns whether the last frame is in flight, as of the last has_completed() or wait().
  bool in_flight() const { return in_flight_; }
  // Checks whether the last frame has completed.
  Result<bool> has_completed();
  Status wait();

  // Begins recording a frame; the last one must have completed. Rendering goes to `draw`, commands
  // that wait for the caller's semaphores go to `output`.
  Status begin();
  VkCommandBuffer draw() const { return commands_[0]; }
  VkCommandBuffer output() const { return commands_[1]; }
  FrameCommands& sets() { return sets_; }
  VkBuffer counts_buffer() const { return counts_.handle(); }
  VkQueryPool timestamps() const { return timestamps_.pool(); }
  // Submits both command buffers.
  Status submit(std::span<const VulkanSemaphore> wait, std::span<const VulkanSemaphore> signal);

  // Return the results of a completed frame.
  Counts counts() const;
  Status add_times(RenderStats& stats) const;

  std::uint64_t number = 0;     // of the frame
  std::uint64_t capacity = 0;   // of instances in its buffers
  RenderStats stats;            // the part that the host knows
  std::vector<Buffer> staging;  // that its commands copy from

 private:
  Device* device_ = nullptr;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  std::array<VkCommandBuffer, 2> commands_{};
  VkFence fence_ = VK_NULL_HANDLE;
  Timestamps timestamps_;
  FrameCommands sets_;
  Buffer counts_;
  bool in_flight_ = false;
};

}  // namespace stgs::player::vulkan
