// SPDX-License-Identifier: Apache-2.0
// Draws what Dear ImGui has listed into a render pass. ImGui's own Vulkan backend calls the Vulkan
// loader directly, as Debian builds it; this one goes through volk, so that programs start without
// a loader.
#pragma once

#include <array>

#include "play/vulkan_objects.h"

struct ImDrawData;

namespace stgs::tools {

class OverlayPainter {
 public:
  static constexpr std::size_t kFrames = 2;  // on their way at most

  OverlayPainter() = default;
  OverlayPainter(const OverlayPainter&) = delete;
  OverlayPainter& operator=(const OverlayPainter&) = delete;
  ~OverlayPainter();

  // Takes the glyphs of the current ImGui context, and sends them through the queue. `pass`: one
  // colour attachment, as that of every pass it draws in. The device outlives it.
  Status create(VkPhysicalDevice physical, VkDevice device, std::uint32_t family, VkQueue queue,
                VkRenderPass pass);
  // Into a pass that has begun, for the frame `number` modulo kFrames, whose last use has ended.
  Status draw(const ImDrawData& list, std::size_t number, VkCommandBuffer commands);

 private:
  Status make_glyphs(std::uint32_t family, VkQueue queue);
  Status send_glyphs(const std::uint8_t* glyphs, std::uint32_t width, std::uint32_t height,
                     std::uint32_t family, VkQueue queue);
  Status make_set();
  Status make_pipeline(VkRenderPass pass);
  Status send_lists(const ImDrawData& list, std::size_t frame);
  void set_up(const ImDrawData& list, std::size_t frame, VkCommandBuffer commands) const;

  VkPhysicalDevice physical_ = VK_NULL_HANDLE;
  VkDevice device_ = VK_NULL_HANDLE;
  VkImage glyphs_ = VK_NULL_HANDLE;
  VkDeviceMemory glyph_memory_ = VK_NULL_HANDLE;
  VkImageView glyph_view_ = VK_NULL_HANDLE;
  VkSampler sampler_ = VK_NULL_HANDLE;
  VkDescriptorSetLayout set_layout_ = VK_NULL_HANDLE;
  VkDescriptorPool pool_ = VK_NULL_HANDLE;
  VkDescriptorSet set_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkPipeline pipeline_ = VK_NULL_HANDLE;
  std::array<MappedBuffer, kFrames> vertices_, indices_;
};

}  // namespace stgs::tools
