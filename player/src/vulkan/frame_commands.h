// SPDX-License-Identifier: Apache-2.0
// The stages of a view as commands.
#pragma once

#include <span>
#include <vector>

#include "vulkan/frame_buffers.h"
#include "vulkan/pipelines.h"
#include "vulkan/segment_memory.h"

namespace stgs::player::vulkan {

// Of the input's parts, those that lie in one block.
struct BlockParts {
  std::uint32_t block, first_part, parts, groups;
};

// What a view is drawn from and with.
struct FrameWork {
  const ViewInput* input;
  std::span<const Part> parts;  // those of a block side by side
  std::span<const BlockParts> blocks;
  int sh_degree;
  VkBuffer picture;           // kPlanes planes of floats
  std::uint64_t plane_bytes;  // from one to the next
  VkBuffer told;              // where the Counts go, for the host
  VkQueryPool times;          // kTimes of them; null where there are none
};
inline constexpr std::uint32_t kPlanes = 5;  // red, green, blue, alpha, depth
inline constexpr std::uint32_t kTimes = 4;   // begin, sliced, binned, blended

// The sets of buffers that a view's commands use; one command buffer at a time.
class FrameCommands {
 public:
  FrameCommands() = default;
  FrameCommands(const FrameCommands&) = delete;
  FrameCommands& operator=(const FrameCommands&) = delete;
  ~FrameCommands();

  // Records a view. Nothing that was recorded before may still run.
  Status record(const Device& device, const Pipelines& pipelines, const SegmentMemory& memory,
                const FrameBuffers& buffers, const FrameWork& work, VkCommandBuffer commands);

 private:
  class Recorder;
  Status make_room(const Device& device, std::uint32_t sets);

  const Device* device_ = nullptr;
  VkDescriptorPool pool_ = VK_NULL_HANDLE;
  std::uint32_t sets_ = 0;
};

}  // namespace stgs::player::vulkan
