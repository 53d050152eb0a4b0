// SPDX-License-Identifier: Apache-2.0
#include "play/overlay_painter.h"

#include <imgui.h>

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace stgs::tools {
namespace {

constexpr std::uint32_t kVertexCode[] = {
#include "overlay.vert.inc"
};
constexpr std::uint32_t kFragmentCode[] = {
#include "overlay.frag.inc"
};

// Transform from ImGui coordinates to clip space.
struct Push {
  float scale[2], shift[2];
};

void change_layout(VkCommandBuffer commands, VkImage image, bool to_copy) {
  VkImageMemoryBarrier change = image_barrier(image);
  const VkAccessFlags written = VK_ACCESS_TRANSFER_WRITE_BIT, read = VK_ACCESS_SHADER_READ_BIT;
  change.srcAccessMask = to_copy ? 0 : written;
  change.dstAccessMask = to_copy ? written : read;
  change.oldLayout = to_copy ? VK_IMAGE_LAYOUT_UNDEFINED : VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
  change.newLayout =
      to_copy ? VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL : VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL;
  const VkPipelineStageFlags begin = VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT,
                             copy = VK_PIPELINE_STAGE_TRANSFER_BIT,
                             draw = VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT;
  vkCmdPipelineBarrier(commands, to_copy ? begin : copy, to_copy ? copy : draw, 0, 0, nullptr, 0,
                       nullptr, 1, &change);
}

constexpr VkDescriptorSetLayoutBinding kGlyphs{0, VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1,
                                               VK_SHADER_STAGE_FRAGMENT_BIT, nullptr};

// The pipeline state except its shaders: triangles of ImDrawVert, alpha-blended.
struct FixedState {
  FixedState() {
    input.vertexBindingDescriptionCount = 1;
    input.pVertexBindingDescriptions = &binding;
    input.vertexAttributeDescriptionCount = 3;
    input.pVertexAttributeDescriptions = attributes;
    assembly.topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST;
    viewport.viewportCount = 1;
    viewport.scissorCount = 1;
    raster.lineWidth = 1;
    samples.rasterizationSamples = VK_SAMPLE_COUNT_1_BIT;
    blend.attachmentCount = 1;
    blend.pAttachments = &over;
    dynamic.dynamicStateCount = 2;
    dynamic.pDynamicStates = set_later;
  }
  FixedState(const FixedState&) = delete;
  FixedState& operator=(const FixedState&) = delete;

  // The result points into this object.
  VkGraphicsPipelineCreateInfo pipeline() const {
    auto info =
        structure<VkGraphicsPipelineCreateInfo>(VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO);
    info.pVertexInputState = &input;
    info.pInputAssemblyState = &assembly;
    info.pViewportState = &viewport;
    info.pRasterizationState = &raster;
    info.pMultisampleState = &samples;
    info.pColorBlendState = &blend;
    info.pDynamicState = &dynamic;
    return info;
  }

  const VkVertexInputBindingDescription binding{0, sizeof(ImDrawVert), VK_VERTEX_INPUT_RATE_VERTEX};
  const VkVertexInputAttributeDescription attributes[3] = {
      {0, 0, VK_FORMAT_R32G32_SFLOAT, offsetof(ImDrawVert, pos)},
      {1, 0, VK_FORMAT_R32G32_SFLOAT, offsetof(ImDrawVert, uv)},
      {2, 0, VK_FORMAT_R8G8B8A8_UNORM, offsetof(ImDrawVert, col)}};
  const VkPipelineColorBlendAttachmentState over{VK_TRUE,
                                                 VK_BLEND_FACTOR_SRC_ALPHA,
                                                 VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA,
                                                 VK_BLEND_OP_ADD,
                                                 VK_BLEND_FACTOR_ONE,
                                                 VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA,
                                                 VK_BLEND_OP_ADD,
                                                 15};
  const VkDynamicState set_later[2] = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR};
  VkPipelineVertexInputStateCreateInfo input = structure<VkPipelineVertexInputStateCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO);
  VkPipelineInputAssemblyStateCreateInfo assembly =
      structure<VkPipelineInputAssemblyStateCreateInfo>(
          VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO);
  VkPipelineViewportStateCreateInfo viewport = structure<VkPipelineViewportStateCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO);
  VkPipelineRasterizationStateCreateInfo raster = structure<VkPipelineRasterizationStateCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO);
  VkPipelineMultisampleStateCreateInfo samples = structure<VkPipelineMultisampleStateCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO);
  VkPipelineColorBlendStateCreateInfo blend = structure<VkPipelineColorBlendStateCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO);
  VkPipelineDynamicStateCreateInfo dynamic = structure<VkPipelineDynamicStateCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO);
};

}  // namespace

OverlayPainter::~OverlayPainter() {
  if (device_ == nullptr) return;
  vkDestroyPipeline(device_->device, pipeline_, nullptr);
  vkDestroyPipelineLayout(device_->device, layout_, nullptr);
  vkDestroySampler(device_->device, sampler_, nullptr);
  vkDestroyImageView(device_->device, glyph_view_, nullptr);
}

Status OverlayPainter::create(const DeviceHandles& device, VkRenderPass pass) {
  device_ = &device;
  STGS_TRY(make_glyphs());
  STGS_TRY(make_set());
  return make_pipeline(pass);
}

Status OverlayPainter::make_glyphs() {
  unsigned char* glyphs = nullptr;
  int width = 0, height = 0;
  ImGui::GetIO().Fonts->GetTexDataAsAlpha8(&glyphs, &width, &height);
  ImageShape shape;
  shape.format = VK_FORMAT_R8_UNORM;
  shape.width = static_cast<std::uint32_t>(width);
  shape.height = static_cast<std::uint32_t>(height);
  STGS_TRY(glyphs_.create(*device_, shape,
                          VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT));
  STGS_TRY(upload_glyphs(glyphs, shape.width, shape.height));
  return make_view(device_->device, glyphs_.handle(), shape.format, &glyph_view_);
}

Status OverlayPainter::upload_glyphs(const std::uint8_t* glyphs, std::uint32_t width,
                                     std::uint32_t height) {
  MappedBuffer staging;
  const std::size_t bytes = std::size_t{width} * height;
  STGS_TRY(staging.ensure(*device_, VK_BUFFER_USAGE_TRANSFER_SRC_BIT, bytes));
  std::memcpy(staging.data(), glyphs, bytes);
  return run_commands(*device_, [&](VkCommandBuffer commands) {
    change_layout(commands, glyphs_.handle(), true);
    const VkBufferImageCopy region = whole_image(width, height);
    vkCmdCopyBufferToImage(commands, staging.handle(), glyphs_.handle(),
                           VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
    change_layout(commands, glyphs_.handle(), false);
  });
}

Status OverlayPainter::make_set() {
  auto sampler = structure<VkSamplerCreateInfo>(VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO);
  sampler.magFilter = VK_FILTER_LINEAR;
  sampler.minFilter = VK_FILTER_LINEAR;
  sampler.addressModeU = VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE;
  sampler.addressModeV = VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE;
  STGS_TRY(vk_status(vkCreateSampler(device_->device, &sampler, nullptr, &sampler_),
                     "creating a sampler"));
  STGS_TRY(set_.create(device_->device, {&kGlyphs, 1}));
  const VkDescriptorImageInfo image{sampler_, glyph_view_,
                                    VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL};
  set_.write(kGlyphs, &image, nullptr);
  return {};
}

Status OverlayPainter::make_pipeline(VkRenderPass pass) {
  const VkPushConstantRange push{VK_SHADER_STAGE_VERTEX_BIT, 0, sizeof(Push)};
  STGS_TRY(make_pipeline_layout(device_->device, set_, {&push, 1}, &layout_));
  STGS_ASSIGN(const VkShaderModule vertex, make_shader(device_->device, kVertexCode));
  const auto fragment = make_shader(device_->device, kFragmentCode);
  VkResult result = VK_SUCCESS;
  if (fragment.ok()) {
    const FixedState state;
    const VkPipelineShaderStageCreateInfo stages[] = {
        stage_of(VK_SHADER_STAGE_VERTEX_BIT, vertex),
        stage_of(VK_SHADER_STAGE_FRAGMENT_BIT, *fragment)};
    VkGraphicsPipelineCreateInfo info = state.pipeline();
    info.stageCount = 2;
    info.pStages = stages;
    info.layout = layout_;
    info.renderPass = pass;
    result =
        vkCreateGraphicsPipelines(device_->device, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline_);
    vkDestroyShaderModule(device_->device, *fragment, nullptr);
  }
  vkDestroyShaderModule(device_->device, vertex, nullptr);
  STGS_TRY(fragment.status());
  return vk_status(result, "creating a pipeline");
}

Status OverlayPainter::upload_lists(const ImDrawData& list, std::size_t frame) {
  MappedBuffer &vertices = vertices_[frame], &indices = indices_[frame];
  STGS_TRY(vertices.ensure(*device_, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT,
                           sizeof(ImDrawVert) * static_cast<std::size_t>(list.TotalVtxCount)));
  STGS_TRY(indices.ensure(*device_, VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
                          sizeof(ImDrawIdx) * static_cast<std::size_t>(list.TotalIdxCount)));
  std::uint8_t *to_vertices = vertices.data(), *to_indices = indices.data();
  for (int i = 0; i < list.CmdListsCount; ++i) {
    const ImDrawList& one = *list.CmdLists[i];
    const auto vertex_bytes = static_cast<std::size_t>(one.VtxBuffer.size_in_bytes());
    const auto index_bytes = static_cast<std::size_t>(one.IdxBuffer.size_in_bytes());
    std::memcpy(to_vertices, one.VtxBuffer.Data, vertex_bytes);
    std::memcpy(to_indices, one.IdxBuffer.Data, index_bytes);
    to_vertices += vertex_bytes;
    to_indices += index_bytes;
  }
  return {};
}

void OverlayPainter::bind(const ImDrawData& list, std::size_t frame,
                          VkCommandBuffer commands) const {
  vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline_);
  vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, layout_, 0, 1, &set_.handle(),
                          0, nullptr);
  const VkBuffer vertices = vertices_[frame].handle();
  const VkDeviceSize none = 0;
  vkCmdBindVertexBuffers(commands, 0, 1, &vertices, &none);
  vkCmdBindIndexBuffer(commands, indices_[frame].handle(), 0,
                       sizeof(ImDrawIdx) == 2 ? VK_INDEX_TYPE_UINT16 : VK_INDEX_TYPE_UINT32);
  const VkViewport viewport{0,
                            0,
                            list.DisplaySize.x * list.FramebufferScale.x,
                            list.DisplaySize.y * list.FramebufferScale.y,
                            0,
                            1};
  vkCmdSetViewport(commands, 0, 1, &viewport);
  const Push push{{2 / list.DisplaySize.x, 2 / list.DisplaySize.y},
                  {-1 - list.DisplayPos.x * 2 / list.DisplaySize.x,
                   -1 - list.DisplayPos.y * 2 / list.DisplaySize.y}};
  vkCmdPushConstants(commands, layout_, VK_SHADER_STAGE_VERTEX_BIT, 0, sizeof(push), &push);
}

Status OverlayPainter::draw(const ImDrawData& list, std::size_t number, VkCommandBuffer commands) {
  if (list.TotalVtxCount == 0) return {};
  const std::size_t frame = number % kFrames;
  STGS_TRY(upload_lists(list, frame));
  bind(list, frame, commands);
  const ImVec2 corner = list.DisplayPos, scale = list.FramebufferScale;
  const float width = list.DisplaySize.x * scale.x, height = list.DisplaySize.y * scale.y;
  std::uint32_t first_vertex = 0, first_index = 0;
  for (int i = 0; i < list.CmdListsCount; ++i) {
    const ImDrawList& one = *list.CmdLists[i];
    for (const ImDrawCmd& command : one.CmdBuffer) {
      const ImVec4& clip = command.ClipRect;
      const float left = std::max((clip.x - corner.x) * scale.x, 0.0f);
      const float top = std::max((clip.y - corner.y) * scale.y, 0.0f);
      const float right = std::min((clip.z - corner.x) * scale.x, width);
      const float bottom = std::min((clip.w - corner.y) * scale.y, height);
      if (right <= left || bottom <= top) continue;
      const VkRect2D scissor{
          {static_cast<std::int32_t>(left), static_cast<std::int32_t>(top)},
          {static_cast<std::uint32_t>(right - left), static_cast<std::uint32_t>(bottom - top)}};
      vkCmdSetScissor(commands, 0, 1, &scissor);
      vkCmdDrawIndexed(commands, command.ElemCount, 1, first_index + command.IdxOffset,
                       static_cast<std::int32_t>(first_vertex + command.VtxOffset), 0);
    }
    first_vertex += static_cast<std::uint32_t>(one.VtxBuffer.Size);
    first_index += static_cast<std::uint32_t>(one.IdxBuffer.Size);
  }
  return {};
}

}  // namespace stgs::tools
