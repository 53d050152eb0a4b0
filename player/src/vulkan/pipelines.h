// SPDX-License-Identifier: Apache-2.0
// The shaders, ready to be dispatched. All have one layout: set 0 is the frame's buffers
// (frame.glsl), set 1 up to four of the stage, and the constants of frame_layout.h's Push.
#pragma once

#include <array>
#include <span>

#include "vulkan/device.h"

namespace stgs::player::vulkan {

inline constexpr std::uint32_t kFrameBindings = 15, kStageBindings = 4;
inline constexpr int kDegrees = 4;

enum class Shader {
  kProject,         // of one view
  kProjectSeveral,  // views
  kScanChunks,
  kCompact,
  kSortCount,
  kSortScatter,
  kCountTiles,
  kCountTilesFovea,  // where a view has one, as the others of this name
  kListTiles,
  kListTilesFovea,
  kFindRanges,
  kFindPatches,
  kBlend,
  kBlendFovea,
};
inline constexpr std::size_t kShaders = 14;

// Storage buffers for compute shaders, at bindings from 0 on.
Status make_buffers_layout(const Device& device, std::uint32_t count, VkDescriptorSetLayout* out);
// Of `stage` the code is set here.
Status make_pipeline(const Device& device, std::span<const std::uint32_t> code,
                     const VkPipelineShaderStageCreateInfo& stage, VkPipelineLayout layout,
                     VkPipeline* out);

// The device outlives it.
class Pipelines {
 public:
  Pipelines() = default;
  Pipelines(const Pipelines&) = delete;
  Pipelines& operator=(const Pipelines&) = delete;
  ~Pipelines();

  // For scenes of a degree; once for each.
  Status create(const Device& device, int sh_degree);
  VkPipeline of(Shader shader, int sh_degree) const {
    return pipelines_[static_cast<std::size_t>(sh_degree)][static_cast<std::size_t>(shader)];
  }
  VkPipelineLayout layout() const { return layout_; }
  VkDescriptorSetLayout frame_set() const { return sets_[0]; }
  VkDescriptorSetLayout stage_set() const { return sets_[1]; }

 private:
  Status make_layout(const Device& device);
  Status make(const Device& device, Shader shader, int sh_degree, VkPipeline* out) const;

  const Device* device_ = nullptr;
  std::array<VkDescriptorSetLayout, 2> sets_{};
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  std::array<std::array<VkPipeline, kShaders>, kDegrees> pipelines_{};
};

}  // namespace stgs::player::vulkan
