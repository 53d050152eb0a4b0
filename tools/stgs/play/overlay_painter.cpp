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
  auto change = structure<VkImageMemoryBarrier>(VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER);
  const VkAccessFlags written = VK_ACCESS_TRANSFER_WRITE_BIT, read = VK_ACCESS_SHADER_READ_BIT;
  change.srcAccessMask = to_copy ? 0 : written;
  change.dstAccessMask = to_copy ? written : read;
  change.oldLayout = to_copy ? VK_IMAGE_LAYOUT_UNDEFINED : VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
  change.newLayout =
      to_copy ? VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL : VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL;
  change.srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  change.dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED;
  change.image = image;
  change.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  const VkPipelineStageFlags begin = VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT,
                             copy = VK_PIPELINE_STAGE_TRANSFER_BIT,
                             draw = VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT;
  vkCmdPipelineBarrier(commands, to_copy ? begin : copy, to_copy ? copy : draw, 0, 0, nullptr, 0,
                       nullptr, 1, &change);
}

Result<VkShaderModule> make_shader(VkDevice device, const std::uint32_t* code, std::size_t bytes) {
  auto info = structure<VkShaderModuleCreateInfo>(VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO);
  info.codeSize = bytes;
  info.pCode = code;
  VkShaderModule module = VK_NULL_HANDLE;
  STGS_TRY(vk_status(vkCreateShaderModule(device, &info, nullptr, &module), "loading a shader"));
  return module;
}

VkPipelineShaderStageCreateInfo stage_of(VkShaderStageFlagBits stage, VkShaderModule module) {
  auto info = structure<VkPipelineShaderStageCreateInfo>(
      VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO);
  info.stage = stage;
  info.module = module;
  info.pName = "main";
  return info;
}

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
  if (device_ == VK_NULL_HANDLE) return;
  vkDestroyPipeline(device_, pipeline_, nullptr);
  vkDestroyPipelineLayout(device_, layout_, nullptr);
  vkDestroyDescriptorPool(device_, pool_, nullptr);
  vkDestroyDescriptorSetLayout(device_, set_layout_, nullptr);
  vkDestroySampler(device_, sampler_, nullptr);
  vkDestroyImageView(device_, glyph_view_, nullptr);
  vkDestroyImage(device_, glyphs_, nullptr);
  vkFreeMemory(device_, glyph_memory_, nullptr);
}

Status OverlayPainter::create(VkPhysicalDevice physical, VkDevice device, std::uint32_t family,
                              VkQueue queue, VkRenderPass pass) {
  physical_ = physical;
  device_ = device;
  STGS_TRY(make_glyphs(family, queue));
  STGS_TRY(make_set());
  return make_pipeline(pass);
}

Status OverlayPainter::make_glyphs(std::uint32_t family, VkQueue queue) {
  unsigned char* glyphs = nullptr;
  int width = 0, height = 0;
  ImGui::GetIO().Fonts->GetTexDataAsAlpha8(&glyphs, &width, &height);
  auto info = structure<VkImageCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO);
  info.imageType = VK_IMAGE_TYPE_2D;
  info.format = VK_FORMAT_R8_UNORM;
  info.extent = {static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), 1};
  info.mipLevels = 1;
  info.arrayLayers = 1;
  info.samples = VK_SAMPLE_COUNT_1_BIT;
  info.usage = VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT;
  STGS_TRY(vk_status(vkCreateImage(device_, &info, nullptr, &glyphs_), "creating an image"));
  VkMemoryRequirements needs{};
  vkGetImageMemoryRequirements(device_, glyphs_, &needs);
  STGS_TRY(
      allocate(physical_, device_, needs, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, &glyph_memory_));
  STGS_TRY(vk_status(vkBindImageMemory(device_, glyphs_, glyph_memory_, 0), "binding memory"));
  STGS_TRY(upload_glyphs(glyphs, info.extent.width, info.extent.height, family, queue));
  auto view = structure<VkImageViewCreateInfo>(VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO);
  view.image = glyphs_;
  view.viewType = VK_IMAGE_VIEW_TYPE_2D;
  view.format = info.format;
  view.subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1};
  return vk_status(vkCreateImageView(device_, &view, nullptr, &glyph_view_),
                   "creating an image view");
}

Status OverlayPainter::upload_glyphs(const std::uint8_t* glyphs, std::uint32_t width,
                                     std::uint32_t height, std::uint32_t family, VkQueue queue) {
  MappedBuffer staging;
  const std::size_t bytes = std::size_t{width} * height;
  STGS_TRY(staging.ensure(physical_, device_, VK_BUFFER_USAGE_TRANSFER_SRC_BIT, bytes));
  std::memcpy(staging.data(), glyphs, bytes);
  auto pool_info = structure<VkCommandPoolCreateInfo>(VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO);
  pool_info.queueFamilyIndex = family;
  VkCommandPool pool = VK_NULL_HANDLE;
  STGS_TRY(vk_status(vkCreateCommandPool(device_, &pool_info, nullptr, &pool),
                     "creating a command pool"));
  auto info =
      structure<VkCommandBufferAllocateInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO);
  info.commandPool = pool;
  info.commandBufferCount = 1;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  VkResult result = vkAllocateCommandBuffers(device_, &info, &commands);
  auto begin = structure<VkCommandBufferBeginInfo>(VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO);
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  if (result == VK_SUCCESS) result = vkBeginCommandBuffer(commands, &begin);
  if (result == VK_SUCCESS) {
    change_layout(commands, glyphs_, true);
    VkBufferImageCopy region{};
    region.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1};
    region.imageExtent = {width, height, 1};
    vkCmdCopyBufferToImage(commands, staging.handle(), glyphs_,
                           VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1, &region);
    change_layout(commands, glyphs_, false);
    result = vkEndCommandBuffer(commands);
  }
  auto submit = structure<VkSubmitInfo>(VK_STRUCTURE_TYPE_SUBMIT_INFO);
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  if (result == VK_SUCCESS) result = vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE);
  if (result == VK_SUCCESS) result = vkQueueWaitIdle(queue);
  vkDestroyCommandPool(device_, pool, nullptr);
  return vk_status(result, "uploading glyphs");
}

Status OverlayPainter::make_set() {
  auto sampler = structure<VkSamplerCreateInfo>(VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO);
  sampler.magFilter = VK_FILTER_LINEAR;
  sampler.minFilter = VK_FILTER_LINEAR;
  sampler.addressModeU = VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE;
  sampler.addressModeV = VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE;
  STGS_TRY(vk_status(vkCreateSampler(device_, &sampler, nullptr, &sampler_), "creating a sampler"));
  const VkDescriptorSetLayoutBinding binding{0, VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1,
                                             VK_SHADER_STAGE_FRAGMENT_BIT, nullptr};
  auto layout = structure<VkDescriptorSetLayoutCreateInfo>(
      VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO);
  layout.bindingCount = 1;
  layout.pBindings = &binding;
  STGS_TRY(vk_status(vkCreateDescriptorSetLayout(device_, &layout, nullptr, &set_layout_),
                     "creating a descriptor layout"));
  const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1};
  auto pool = structure<VkDescriptorPoolCreateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO);
  pool.maxSets = 1;
  pool.poolSizeCount = 1;
  pool.pPoolSizes = &size;
  STGS_TRY(vk_status(vkCreateDescriptorPool(device_, &pool, nullptr, &pool_),
                     "creating a descriptor pool"));
  auto info =
      structure<VkDescriptorSetAllocateInfo>(VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO);
  info.descriptorPool = pool_;
  info.descriptorSetCount = 1;
  info.pSetLayouts = &set_layout_;
  STGS_TRY(
      vk_status(vkAllocateDescriptorSets(device_, &info, &set_), "allocating a descriptor set"));
  const VkDescriptorImageInfo image{sampler_, glyph_view_,
                                    VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL};
  auto write = structure<VkWriteDescriptorSet>(VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET);
  write.dstSet = set_;
  write.descriptorCount = 1;
  write.descriptorType = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER;
  write.pImageInfo = &image;
  vkUpdateDescriptorSets(device_, 1, &write, 0, nullptr);
  return {};
}

Status OverlayPainter::make_pipeline(VkRenderPass pass) {
  const VkPushConstantRange push{VK_SHADER_STAGE_VERTEX_BIT, 0, sizeof(Push)};
  auto layout =
      structure<VkPipelineLayoutCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO);
  layout.setLayoutCount = 1;
  layout.pSetLayouts = &set_layout_;
  layout.pushConstantRangeCount = 1;
  layout.pPushConstantRanges = &push;
  STGS_TRY(vk_status(vkCreatePipelineLayout(device_, &layout, nullptr, &layout_),
                     "creating a pipeline layout"));
  STGS_ASSIGN(const VkShaderModule vertex, make_shader(device_, kVertexCode, sizeof(kVertexCode)));
  const auto fragment = make_shader(device_, kFragmentCode, sizeof(kFragmentCode));
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
    result = vkCreateGraphicsPipelines(device_, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline_);
    vkDestroyShaderModule(device_, *fragment, nullptr);
  }
  vkDestroyShaderModule(device_, vertex, nullptr);
  STGS_TRY(fragment.status());
  return vk_status(result, "creating a pipeline");
}

Status OverlayPainter::upload_lists(const ImDrawData& list, std::size_t frame) {
  MappedBuffer &vertices = vertices_[frame], &indices = indices_[frame];
  STGS_TRY(vertices.ensure(physical_, device_, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT,
                           sizeof(ImDrawVert) * static_cast<std::size_t>(list.TotalVtxCount)));
  STGS_TRY(indices.ensure(physical_, device_, VK_BUFFER_USAGE_INDEX_BUFFER_BIT,
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
  vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, layout_, 0, 1, &set_, 0,
                          nullptr);
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
