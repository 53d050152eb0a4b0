// SPDX-License-Identifier: Apache-2.0
#include "vulkan/pipelines.h"

#include <vector>

#include "frame_layout.h"

namespace stgs::player::vulkan {
namespace {

constexpr std::uint32_t kProjectCode[] = {
#include "project.spv.inc"
};
constexpr std::uint32_t kScanChunksCode[] = {
#include "scan_chunks.spv.inc"
};
constexpr std::uint32_t kScanChunksBallotCode[] = {
#include "scan_chunks_ballot.spv.inc"
};
constexpr std::uint32_t kCompactCode[] = {
#include "compact.spv.inc"
};
constexpr std::uint32_t kSortCountCode[] = {
#include "sort_count.spv.inc"
};
constexpr std::uint32_t kSortCountBallotCode[] = {
#include "sort_count_ballot.spv.inc"
};
constexpr std::uint32_t kSortScatterCode[] = {
#include "sort_scatter.spv.inc"
};
constexpr std::uint32_t kSortScatterBallotCode[] = {
#include "sort_scatter_ballot.spv.inc"
};
constexpr std::uint32_t kCountTilesCode[] = {
#include "count_tiles.spv.inc"
};
constexpr std::uint32_t kCountTilesBallotCode[] = {
#include "count_tiles_ballot.spv.inc"
};
constexpr std::uint32_t kListTilesCode[] = {
#include "list_tiles.spv.inc"
};
constexpr std::uint32_t kListTilesBallotCode[] = {
#include "list_tiles_ballot.spv.inc"
};
constexpr std::uint32_t kFindRangesCode[] = {
#include "find_ranges.spv.inc"
};
constexpr std::uint32_t kFindPatchesCode[] = {
#include "find_patches.spv.inc"
};
constexpr std::uint32_t kBlendCode[] = {
#include "blend.spv.inc"
};
constexpr std::uint32_t kBlendBallotCode[] = {
#include "blend_ballot.spv.inc"
};

struct Code {
  std::span<const std::uint32_t> portable, ballot;  // for unknown and for known subgroup sizes
};

Code code_of(Shader shader) {
  switch (shader) {
    case Shader::kProject:
    case Shader::kProjectSeveral:
      return {kProjectCode, kProjectCode};
    case Shader::kScanChunks:
      return {kScanChunksCode, kScanChunksBallotCode};
    case Shader::kCompact:
      return {kCompactCode, kCompactCode};
    case Shader::kSortCount:
      return {kSortCountCode, kSortCountBallotCode};
    case Shader::kSortScatter:
      return {kSortScatterCode, kSortScatterBallotCode};
    case Shader::kCountTiles:
    case Shader::kCountTilesFovea:
      return {kCountTilesCode, kCountTilesBallotCode};
    case Shader::kListTiles:
    case Shader::kListTilesFovea:
      return {kListTilesCode, kListTilesBallotCode};
    case Shader::kFindRanges:
      return {kFindRangesCode, kFindRangesCode};
    case Shader::kFindPatches:
      return {kFindPatchesCode, kFindPatchesCode};
    case Shader::kBlend:
    case Shader::kBlendFovea:
      break;
  }
  return {kBlendCode, kBlendBallotCode};
}

}  // namespace

Status make_buffers_layout(const Device& device, std::uint32_t count, VkDescriptorSetLayout* out) {
  std::vector<VkDescriptorSetLayoutBinding> bindings;
  for (std::uint32_t i = 0; i < count; ++i) {
    bindings.push_back(
        {i, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
  }
  auto info = structure<VkDescriptorSetLayoutCreateInfo>(
      VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO);
  info.bindingCount = count;
  info.pBindings = bindings.data();
  return vk_status(device.vk.vkCreateDescriptorSetLayout(device.handle(), &info, nullptr, out),
                   "creating a descriptor set layout");
}

Status make_pipeline(const Device& device, std::span<const std::uint32_t> code,
                     const VkPipelineShaderStageCreateInfo& stage, VkPipelineLayout layout,
                     VkPipeline* out) {
  auto module = structure<VkShaderModuleCreateInfo>(VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
  module.codeSize = code.size_bytes();
  module.pCode = code.data();
  auto info =
      structure<VkComputePipelineCreateInfo>(VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO);
  info.stage = stage;
  info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
  info.stage.pName = "main";
  info.layout = layout;
  STGS_TRY(vk_status(
      device.vk.vkCreateShaderModule(device.handle(), &module, nullptr, &info.stage.module),
      "creating a shader module"));
  const VkResult result =
      device.vk.vkCreateComputePipelines(device.handle(), VK_NULL_HANDLE, 1, &info, nullptr, out);
  device.vk.vkDestroyShaderModule(device.handle(), info.stage.module, nullptr);
  return vk_status(result, "creating a compute pipeline");
}

Pipelines::~Pipelines() {
  if (device_ == nullptr) return;
  const auto& vk = device_->vk;
  for (const auto& degree : pipelines_) {
    for (const VkPipeline pipeline : degree) {
      vk.vkDestroyPipeline(device_->handle(), pipeline, nullptr);
    }
  }
  vk.vkDestroyPipelineLayout(device_->handle(), layout_, nullptr);
  for (const VkDescriptorSetLayout set : sets_) {
    vk.vkDestroyDescriptorSetLayout(device_->handle(), set, nullptr);
  }
}

Status Pipelines::create(const Device& device, int sh_degree) {
  if (layout_ == VK_NULL_HANDLE) STGS_TRY(create_layout(device));
  auto& pipelines = pipelines_[static_cast<std::size_t>(sh_degree)];
  for (std::size_t i = 0; i < kShaders; ++i) {
    if (pipelines[i] != VK_NULL_HANDLE) continue;
    STGS_TRY(create_one(device, static_cast<Shader>(i), sh_degree, &pipelines[i]));
  }
  return {};
}

Status Pipelines::create_layout(const Device& device) {
  device_ = &device;
  const std::uint32_t counts[] = {kFrameBindings, kStageBindings};
  for (std::size_t set = 0; set < sets_.size(); ++set) {
    STGS_TRY(make_buffers_layout(device, counts[set], &sets_[set]));
  }
  const VkPushConstantRange push{VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof(Push)};
  auto info = structure<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
  info.setLayoutCount = 2;
  info.pSetLayouts = sets_.data();
  info.pushConstantRangeCount = 1;
  info.pPushConstantRanges = &push;
  return vk_status(device.vk.vkCreatePipelineLayout(device.handle(), &info, nullptr, &layout_),
                   "creating a pipeline layout");
}

Status Pipelines::create_one(const Device& device, Shader shader, int sh_degree,
                             VkPipeline* out) const {
  const std::uint32_t lanes = device.subgroups().lanes;
  const Code codes = code_of(shader);
  const std::span<const std::uint32_t> code = lanes != 0 ? codes.ballot : codes.portable;
  const bool projects = shader == Shader::kProject || shader == Shader::kProjectSeveral;
  const bool fovea = shader == Shader::kCountTilesFovea || shader == Shader::kListTilesFovea ||
                     shader == Shader::kBlendFovea;
  const std::uint32_t numbers[] = {
      projects ? static_cast<std::uint32_t>(sh_degree) : lanes,
      projects ? shader == Shader::kProjectSeveral ? VK_TRUE : VK_FALSE : kQuarters * lanes,
      fovea ? VK_TRUE : VK_FALSE};
  constexpr std::uint32_t kEach = sizeof(numbers[0]);
  const VkSpecializationMapEntry entries[] = {
      {0, 0, kEach}, {1, kEach, kEach}, {2, 2 * kEach, kEach}};
  const VkSpecializationInfo constants{3, entries, sizeof(numbers), numbers};
  auto stage = structure<VkPipelineShaderStageCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO);
  stage.pSpecializationInfo = &constants;
  auto size = structure<VkPipelineShaderStageRequiredSubgroupSizeCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_REQUIRED_SUBGROUP_SIZE_CREATE_INFO);
  size.requiredSubgroupSize = lanes;
  if (device.subgroups().required && codes.ballot.data() != codes.portable.data()) {
    stage.pNext = &size;
    stage.flags = VK_PIPELINE_SHADER_STAGE_CREATE_REQUIRE_FULL_SUBGROUPS_BIT;
  }
  return make_pipeline(device, code, stage, layout_, out);
}

}  // namespace stgs::player::vulkan
