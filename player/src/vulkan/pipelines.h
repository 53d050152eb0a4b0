// SPDX-License-Identifier: Apache-2.0
// The compute pipelines. All have one layout: set 0 holds the frame's buffers (frame.glsl), set 1
// up to four buffers of the stage, and the push constants are Push of frame_layout.h.
#pragma once

#include <array>
#include <span>

#include "vulkan/device.h"

namespace stgs::player::vulkan {

inline constexpr std::uint32_t kFrameBindings = 15, kStageBindings = 4;
inline constexpr int kDegrees = 4;

enum class Shader {
  kProject,         // one view
  kProjectSeveral,  // several views
  kScanChunks,
  kCompact,
  kSortCount,
  kSortScatter,
  kCountTiles,
  kCountTilesFovea,  // ...Fovea: used if a view has a fovea
  kListTiles,
  kListTilesFovea,
  kFindRanges,
  kFindPatches,
  kBlend,
  kBlendFovea,
};
inline constexpr std::size_t kShaders = 14;

// Creates a descriptor set layout of `count` storage buffers for compute shaders, from binding 0
// on.
Status make_buffers_layout(const Device& device, std::uint32_t count, VkDescriptorSetLayout* out);
// Creates a compute pipeline. Sets the module of `stage` from `code`.
Status make_pipeline(const Device& device, std::span<const std::uint32_t> code,
                     const VkPipelineShaderStageCreateInfo& stage, VkPipelineLayout layout,
                     VkPipeline* out);

// The pipelines of a device, which outlives them.
class Pipelines {
 public:
  Pipelines() = default;
  Pipelines(const Pipelines&) = delete;
  Pipelines& operator=(const Pipelines&) = delete;
  ~Pipelines();

  // Creates the pipelines for an SH degree, unless they exist.
  Status create(const Device& device, int sh_degree);
  VkPipeline of(Shader shader, int sh_degree) const {
    return pipelines_[static_cast<std::size_t>(sh_degree)][static_cast<std::size_t>(shader)];
  }
  VkPipelineLayout layout() const { return layout_; }
  VkDescriptorSetLayout frame_set() const { return sets_[0]; }
  VkDescriptorSetLayout stage_set() const { return sets_[1]; }

 private:
  Status create_layout(const Device& device);
  Status create_one(const Device& device, Shader shader, int sh_degree, VkPipeline* out) const;

  const Device* device_ = nullptr;
  std::array<VkDescriptorSetLayout, 2> sets_{};
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  std::array<std::array<VkPipeline, kShaders>, kDegrees> pipelines_{};
};

}  // namespace stgs::player::vulkan
