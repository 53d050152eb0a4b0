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

inline constexpr std::uint32_t kPlanes = 5;  // red, green, blue, alpha, depth
inline constexpr std::uint32_t kTimes = 4;   // begin, sliced, binned, blended

// Whose times can be told, in their order.
enum FrameStep { kClear, kProject, kCompact, kDepthSort, kList, kTileSort, kBlend, kFrameSteps };

// Where the picture of a view goes.
struct PictureBuffers {
  std::uint32_t pixels = kPixelPlanes;
  // Of kPixelPlanes all; else depth where it is wanted. What is not written is null.
  std::array<VkDescriptorBufferInfo, kPlanes> planes{};
  VkBuffer packed = VK_NULL_HANDLE;  // of other pixels
};

// What a frame is drawn from and with.
struct FrameWork {
  const FrameInput* input;
  std::span<const Part> parts;  // those of a block side by side
  std::span<const BlockParts> blocks;
  int sh_degree;
  std::span<const PictureBuffers> pictures;  // of each view
  VkBuffer told;                             // where the Counts go, for the host
  VkQueryPool times;                         // kTimes of them; null where there are none
  VkQueryPool step_times;                    // kFrameSteps + 1 of them, likewise
  bool fovea;  // whether a view has one: splats are listed by rows of squares of 2 x 2 tiles
};

// The sets of buffers that a frame's commands use; one command buffer at a time.
class FrameCommands {
 public:
  FrameCommands() = default;
  FrameCommands(const FrameCommands&) = delete;
  FrameCommands& operator=(const FrameCommands&) = delete;
  ~FrameCommands();

  // Records a frame. Nothing that was recorded before may still run.
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
