// SPDX-License-Identifier: Apache-2.0
// Records the rendering stages of a frame.
#pragma once

#include <span>
#include <vector>

#include "vulkan/frame_buffers.h"
#include "vulkan/pipelines.h"
#include "vulkan/segment_memory.h"

namespace stgs::player::vulkan {

// The input parts that lie in one block of memory.
struct BlockParts {
  std::uint32_t block, first_part, parts, groups;
};

inline constexpr std::uint32_t kPlanes = 5;           // red, green, blue, alpha, depth
inline constexpr std::uint32_t kStageTimestamps = 4;  // begin, sliced, binned, blended

// Steps that can be measured, in execution order.
enum FrameStep { kClear, kProject, kCompact, kDepthSort, kList, kTileSort, kBlend, kFrameSteps };

// The output buffers of a view.
struct ImageBuffers {
  std::uint32_t pixels = kPixelPlanes;
  // All planes for kPixelPlanes, else depth if requested. Planes that are not written are null.
  std::array<VkDescriptorBufferInfo, kPlanes> planes{};
  VkBuffer packed = VK_NULL_HANDLE;  // for other pixels
};

// The input and output of a frame.
struct FrameWork {
  const FrameInput* input;
  std::span<const Part> parts;  // grouped by block
  std::span<const BlockParts> blocks;
  int sh_degree;
  std::span<const ImageBuffers> images;  // one per view
  VkBuffer counts;                       // receives the Counts for the host
  VkQueryPool stage_timestamps;          // kStageTimestamps; null: not measured
  VkQueryPool step_timestamps;           // kFrameSteps + 1; null: not measured
  bool fovea;  // a view has one: splats are listed by rows of squares of 2 x 2 tiles
};

// The descriptor sets of a frame. Serves one command buffer at a time.
class FrameCommands {
 public:
  FrameCommands() = default;
  FrameCommands(const FrameCommands&) = delete;
  FrameCommands& operator=(const FrameCommands&) = delete;
  ~FrameCommands();

  // Records a frame. Commands recorded before must have completed.
  Status record(const Device& device, const Pipelines& pipelines, const SegmentMemory& memory,
                const FrameBuffers& buffers, const FrameWork& work, VkCommandBuffer commands);

 private:
  class Recorder;
  Status reset_pool(const Device& device, std::uint32_t sets);

  const Device* device_ = nullptr;
  VkDescriptorPool pool_ = VK_NULL_HANDLE;
  std::uint32_t sets_ = 0;
};

}  // namespace stgs::player::vulkan
