// SPDX-License-Identifier: Apache-2.0
#include "compositor.h"

#include <algorithm>
#include <cmath>

namespace app {
namespace {

constexpr std::uint32_t kGeometryVertex[] = {
#include "geometry.vert.inc"
};
constexpr std::uint32_t kGeometryFragment[] = {
#include "geometry.frag.inc"
};
constexpr std::uint32_t kCompositeVertex[] = {
#include "composite.vert.inc"
};
constexpr std::uint32_t kCompositeFragment[] = {
#include "composite.frag.inc"
};
constexpr std::uint32_t kVertices = 42;  // geometry.vert
constexpr VkFormat kDepthBuffer = VK_FORMAT_D32_SFLOAT;
constexpr VkShaderStageFlags kStages = VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT;

Matrix operator*(const Matrix& a, const Matrix& b) {
  Matrix out{};
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) {
      for (int k = 0; k < 4; ++k) {
        out.at[4 * column + row] += a.at[4 * k + row] * b.at[4 * column + k];
      }
    }
  }
  return out;
}

Matrix camera_from_scene(const stgs_view& view) {
  const float* r = view.rotation;  // row-major
  const float* t = view.translation;
  return {{r[0], r[3], r[6], 0, r[1], r[4], r[7], 0, r[2], r[5], r[8], 0, t[0], t[1], t[2], 1}};
}

// Projection of a view. Camera axes and Vulkan clip space agree: x right, y down, z forward. Depth
// is near / z: 1 at the near plane, 0 at infinity.
Matrix clip_from_camera(const stgs_view& view) {
  const auto w = static_cast<float>(view.width), h = static_cast<float>(view.height);
  return {{2 * view.fx / w, 0, 0, 0, 0, 2 * view.fy / h, 0, 0, 2 * view.cx / w - 1,
           2 * view.cy / h - 1, 0, 1, 0, 0, view.near_plane, 0}};
}

// The axes of the cube: y up, the others arbitrary.
Matrix scene_from_app(const Placement& cube) {
  const float* y = cube.up;
  // The coordinate axis least parallel to y, so that the cross product is not 0.
  float other[3] = {};
  const auto by_magnitude = [](float a, float b) { return std::abs(a) < std::abs(b); };
  other[std::min_element(y, y + 3, by_magnitude) - y] = 1;
  float x[3] = {other[1] * y[2] - other[2] * y[1], other[2] * y[0] - other[0] * y[2],
                other[0] * y[1] - other[1] * y[0]};
  const float length = std::hypot(x[0], x[1], x[2]);
  for (float& v : x) v /= length;
  const float z[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2],
                      x[0] * y[1] - x[1] * y[0]};
  const float s = cube.half_edge;
  const float* c = cube.centre;
  return {{s * x[0], s * x[1], s * x[2], 0, s * y[0], s * y[1], s * y[2], 0, s * z[0], s * z[1],
           s * z[2], 0, c[0], c[1], c[2], 1}};
}

VkRenderingAttachmentInfo cleared(VkImageView view, VkImageLayout layout, VkClearValue value) {
  VkRenderingAttachmentInfo out{};
  out.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO;
  out.imageView = view;
  out.imageLayout = layout;
  out.loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR;
  out.storeOp = VK_ATTACHMENT_STORE_OP_STORE;
  out.clearValue = value;
  return out;
}

}  // namespace

stgs_view first_view(stgs_scene* scene) {
  stgs_view view{};
  view.struct_size = sizeof view;
  stgs_result result = stgs_scene_start_view(scene, &view);
  if (result == STGS_ERROR_UNSUPPORTED) result = stgs_scene_frame_view(scene, &view);
  check(result, scene);
  return view;
}

Placement centre_of(const stgs_scene_info& info, const stgs_view& camera) {
  Placement cube{};
  const bool has_up = std::hypot(info.up[0], info.up[1], info.up[2]) > 0;
  float diagonal = 0;
  for (int i = 0; i < 3; ++i) {
    cube.centre[i] = (info.bounds_min[i] + info.bounds_max[i]) / 2;
    cube.up[i] = has_up ? info.up[i] : -camera.rotation[3 + i];
    diagonal = std::hypot(diagonal, info.bounds_max[i] - info.bounds_min[i]);
  }
  cube.half_edge = diagonal / 25;
  return cube;
}

Compositor::Compositor(Gpu& gpu, VkFormat format, const std::vector<VkExtent2D>& sizes)
    : gpu_(gpu), commands_(gpu.allocate_commands()), timeline_(gpu.create_timeline()) {
  create_layouts();
  geometry_ = create_pipeline(format, false);
  composite_ = create_pipeline(format, true);
  for (const VkExtent2D size : sizes) eyes_.push_back(create_eye(size));
  const stgs_vulkan_device device = gpu.stgs_device();
  if (stgs_vulkan_renderer_create(&device, nullptr, &renderer_) != STGS_OK) {
    throw std::runtime_error("cannot create an STGS renderer on the device");
  }
}

Compositor::~Compositor() {
  vkQueueWaitIdle(gpu_.queue);
  stgs_renderer_destroy(renderer_);
}

void Compositor::create_layouts() {
  VkSamplerCreateInfo sampler{};
  sampler.sType = VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO;
  check(vkCreateSampler(gpu_.device, &sampler, nullptr, &sampler_), "creating a sampler");
  gpu_.defer([&gpu = gpu_, it = sampler_] { vkDestroySampler(gpu.device, it, nullptr); });
  VkDescriptorSetLayoutBinding bindings[2] = {};
  for (std::uint32_t i = 0; i < 2; ++i) {
    bindings[i] = {i, VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1, VK_SHADER_STAGE_FRAGMENT_BIT,
                   nullptr};
  }
  VkDescriptorSetLayoutCreateInfo set{};
  set.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
  set.bindingCount = 2;
  set.pBindings = bindings;
  check(vkCreateDescriptorSetLayout(gpu_.device, &set, nullptr, &scene_layout_),
        "creating a layout");
  gpu_.defer(
      [&gpu = gpu_, it = scene_layout_] { vkDestroyDescriptorSetLayout(gpu.device, it, nullptr); });
  const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 2 * STGS_MAX_VIEWS};
  VkDescriptorPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO;
  pool.maxSets = STGS_MAX_VIEWS;
  pool.poolSizeCount = 1;
  pool.pPoolSizes = &size;
  check(vkCreateDescriptorPool(gpu_.device, &pool, nullptr, &descriptors_),
        "creating a descriptor pool");
  gpu_.defer(
      [&gpu = gpu_, it = descriptors_] { vkDestroyDescriptorPool(gpu.device, it, nullptr); });
  const VkPushConstantRange push{kStages, 0, sizeof(Matrix)};
  VkPipelineLayoutCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
  info.setLayoutCount = 1;
  info.pSetLayouts = &scene_layout_;
  info.pushConstantRangeCount = 1;
  info.pPushConstantRanges = &push;
  check(vkCreatePipelineLayout(gpu_.device, &info, nullptr, &layout_), "creating a layout");
  gpu_.defer([&gpu = gpu_, it = layout_] { vkDestroyPipelineLayout(gpu.device, it, nullptr); });
}

VkPipeline Compositor::create_pipeline(VkFormat format, bool composite) {
  VkPipelineShaderStageCreateInfo stages[2] = {};
  stages[0].stage = VK_SHADER_STAGE_VERTEX_BIT;
  stages[0].module =
      composite ? gpu_.create_shader(kCompositeVertex) : gpu_.create_shader(kGeometryVertex);
  stages[1].stage = VK_SHADER_STAGE_FRAGMENT_BIT;
  stages[1].module =
      composite ? gpu_.create_shader(kCompositeFragment) : gpu_.create_shader(kGeometryFragment);
  for (auto& stage : stages) {
    stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
    stage.pName = "main";
  }
  VkPipelineVertexInputStateCreateInfo vertices{};
  vertices.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO;
  VkPipelineInputAssemblyStateCreateInfo assembly{};
  assembly.sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO;
  assembly.topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST;
  VkPipelineViewportStateCreateInfo viewport{};
  viewport.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO;
  viewport.viewportCount = viewport.scissorCount = 1;
  VkPipelineRasterizationStateCreateInfo raster{};
  raster.sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO;
  raster.lineWidth = 1;
  VkPipelineMultisampleStateCreateInfo samples{};
  samples.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO;
  samples.rasterizationSamples = VK_SAMPLE_COUNT_1_BIT;
  VkPipelineDepthStencilStateCreateInfo depth{};
  depth.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO;
  depth.depthTestEnable = VK_TRUE;
  depth.depthWriteEnable = composite ? VK_FALSE : VK_TRUE;
  depth.depthCompareOp = VK_COMPARE_OP_GREATER;  // 1 at the near plane
  VkPipelineColorBlendAttachmentState blend{};
  blend.blendEnable = composite ? VK_TRUE : VK_FALSE;
  blend.srcColorBlendFactor = blend.srcAlphaBlendFactor = VK_BLEND_FACTOR_ONE;
  blend.dstColorBlendFactor = blend.dstAlphaBlendFactor = VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA;
  blend.colorWriteMask = VK_COLOR_COMPONENT_R_BIT | VK_COLOR_COMPONENT_G_BIT |
                         VK_COLOR_COMPONENT_B_BIT | VK_COLOR_COMPONENT_A_BIT;
  VkPipelineColorBlendStateCreateInfo blending{};
  blending.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO;
  blending.attachmentCount = 1;
  blending.pAttachments = &blend;
  const VkDynamicState states[] = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR};
  VkPipelineDynamicStateCreateInfo dynamic{};
  dynamic.sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO;
  dynamic.dynamicStateCount = 2;
  dynamic.pDynamicStates = states;
  VkPipelineRenderingCreateInfo rendering{};
  rendering.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO;
  rendering.colorAttachmentCount = 1;
  rendering.pColorAttachmentFormats = &format;
  rendering.depthAttachmentFormat = kDepthBuffer;
  VkGraphicsPipelineCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO;
  info.pNext = &rendering;
  info.stageCount = 2;
  info.pStages = stages;
  info.pVertexInputState = &vertices;
  info.pInputAssemblyState = &assembly;
  info.pViewportState = &viewport;
  info.pRasterizationState = &raster;
  info.pMultisampleState = &samples;
  info.pDepthStencilState = &depth;
  info.pColorBlendState = &blending;
  info.pDynamicState = &dynamic;
  info.layout = layout_;
  VkPipeline pipeline = VK_NULL_HANDLE;
  check(vkCreateGraphicsPipelines(gpu_.device, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline),
        "creating a pipeline");
  gpu_.defer([&gpu = gpu_, pipeline] { vkDestroyPipeline(gpu.device, pipeline, nullptr); });
  return pipeline;
}

Compositor::Eye Compositor::create_eye(VkExtent2D size) {
  constexpr VkImageUsageFlags kScene = VK_IMAGE_USAGE_TRANSFER_DST_BIT | VK_IMAGE_USAGE_SAMPLED_BIT;
  const auto create = [&](VkFormat format, VkImageUsageFlags usage, VkImageAspectFlags aspect) {
    return gpu_.create_image(format, size.width, size.height, usage, aspect);
  };
  Eye eye{};
  eye.colour = create(VK_FORMAT_R8G8B8A8_UNORM, kScene, VK_IMAGE_ASPECT_COLOR_BIT);
  eye.depth = create(VK_FORMAT_R32_SFLOAT, kScene, VK_IMAGE_ASPECT_COLOR_BIT);
  eye.depth_buffer =
      create(kDepthBuffer, VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT, VK_IMAGE_ASPECT_DEPTH_BIT);
  VkDescriptorSetAllocateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO;
  info.descriptorPool = descriptors_;
  info.descriptorSetCount = 1;
  info.pSetLayouts = &scene_layout_;
  check(vkAllocateDescriptorSets(gpu_.device, &info, &eye.scene), "allocating descriptors");
  const VkDescriptorImageInfo images[] = {
      {sampler_, eye.colour.view, VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL},
      {sampler_, eye.depth.view, VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL}};
  VkWriteDescriptorSet write{};
  write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
  write.dstSet = eye.scene;
  write.descriptorCount = 2;  // consecutive bindings
  write.descriptorType = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER;
  write.pImageInfo = images;
  vkUpdateDescriptorSets(gpu_.device, 1, &write, 0, nullptr);
  return eye;
}

// Renders colour and depth of all views with one call, once the application has finished reading
// the images.
void Compositor::submit_scene(stgs_scene* scene, double seconds,
                              const std::vector<stgs_view>& views) {
  std::vector<stgs_vulkan_target> targets(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    stgs_vulkan_target_defaults(&targets[i], sizeof targets[i]);
    const auto fill = [](stgs_vulkan_image& to, const Image& from) {
      to.image = from.image;
      to.format = from.format;
      to.width = from.width;
      to.height = from.height;
      to.final_layout = VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL;
    };
    fill(targets[i].colour, eyes_[i].colour);
    fill(targets[i].depth, eyes_[i].depth);
  }
  const stgs_vulkan_semaphore before{timeline_, value_}, after{timeline_, value_ + 1};
  stgs_vulkan_frame frame;
  stgs_vulkan_frame_defaults(&frame, sizeof frame);
  frame.views = views.data();
  frame.targets = targets.data();
  frame.count = static_cast<std::uint32_t>(views.size());
  frame.wait = &before;
  frame.wait_count = value_ > 0 ? 1 : 0;
  frame.signal = &after;
  frame.signal_count = 1;
  check(stgs_vulkan_submit(renderer_, scene, seconds, &frame, nullptr), renderer_);
  ++value_;
}

void Compositor::record(const Eye& eye, const stgs_view& view, const Output& output,
                        const Placement& cube) {
  change_layout(commands_, output.image, VK_IMAGE_LAYOUT_UNDEFINED,
                VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL);
  change_layout(commands_, eye.depth_buffer.image, VK_IMAGE_LAYOUT_UNDEFINED,
                VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL, VK_IMAGE_ASPECT_DEPTH_BIT);
  VkClearValue sky{}, far{};
  sky.color = {{0.08f, 0.1f, 0.14f, 1}};
  far.depthStencil = {0, 0};
  const auto colour = cleared(output.view, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL, sky);
  const auto depth = cleared(eye.depth_buffer.view, VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL, far);
  const VkRect2D area{{0, 0}, {view.width, view.height}};
  VkRenderingInfo rendering{};
  rendering.sType = VK_STRUCTURE_TYPE_RENDERING_INFO;
  rendering.renderArea = area;
  rendering.layerCount = 1;
  rendering.colorAttachmentCount = 1;
  rendering.pColorAttachments = &colour;
  rendering.pDepthAttachment = &depth;
  vkCmdBeginRendering(commands_, &rendering);
  const VkViewport viewport{0, 0, static_cast<float>(view.width), static_cast<float>(view.height),
                            0, 1};
  vkCmdSetViewport(commands_, 0, 1, &viewport);
  vkCmdSetScissor(commands_, 0, 1, &area);
  const Matrix clip = clip_from_camera(view) * camera_from_scene(view) * scene_from_app(cube);
  vkCmdBindPipeline(commands_, VK_PIPELINE_BIND_POINT_GRAPHICS, geometry_);
  vkCmdPushConstants(commands_, layout_, kStages, 0, sizeof clip, &clip);
  vkCmdDraw(commands_, kVertices, 1, 0, 0);
  vkCmdBindPipeline(commands_, VK_PIPELINE_BIND_POINT_GRAPHICS, composite_);
  vkCmdBindDescriptorSets(commands_, VK_PIPELINE_BIND_POINT_GRAPHICS, layout_, 0, 1, &eye.scene, 0,
                          nullptr);
  vkCmdPushConstants(commands_, layout_, kStages, 0, sizeof view.near_plane, &view.near_plane);
  vkCmdDraw(commands_, 3, 1, 0, 0);
  vkCmdEndRendering(commands_);
}

void Compositor::render(stgs_scene* scene, double seconds, const std::vector<stgs_view>& views,
                        const std::vector<Output>& outputs, const Placement& cube) {
  wait();  // until the command buffer is free
  submit_scene(scene, seconds, views);
  VkCommandBufferBeginInfo begin{};
  begin.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  check(vkBeginCommandBuffer(commands_, &begin), "beginning commands");
  for (std::size_t i = 0; i < views.size(); ++i) record(eyes_[i], views[i], outputs[i], cube);
  check(vkEndCommandBuffer(commands_), "ending commands");
  VkSemaphoreSubmitInfo semaphores[2] = {};
  for (std::uint64_t i = 0; i < 2; ++i) {
    semaphores[i].sType = VK_STRUCTURE_TYPE_SEMAPHORE_SUBMIT_INFO;
    semaphores[i].semaphore = timeline_;
    semaphores[i].value = value_ + i;
    semaphores[i].stageMask = VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT;
  }
  ++value_;
  VkCommandBufferSubmitInfo commands{};
  commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_SUBMIT_INFO;
  commands.commandBuffer = commands_;
  VkSubmitInfo2 submit{};
  submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO_2;
  submit.waitSemaphoreInfoCount = submit.signalSemaphoreInfoCount = 1;
  submit.pWaitSemaphoreInfos = &semaphores[0];
  submit.pSignalSemaphoreInfos = &semaphores[1];
  submit.commandBufferInfoCount = 1;
  submit.pCommandBufferInfos = &commands;
  check(vkQueueSubmit2(gpu_.queue, 1, &submit, VK_NULL_HANDLE), "submitting");
}

void Compositor::wait() {
  VkSemaphoreWaitInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SEMAPHORE_WAIT_INFO;
  info.semaphoreCount = 1;
  info.pSemaphores = &timeline_;
  info.pValues = &value_;
  check(vkWaitSemaphores(gpu_.device, &info, UINT64_MAX), "waiting for a frame");
}

}  // namespace app
