// SPDX-License-Identifier: Apache-2.0
// Renders Dear ImGui draw lists into a render pass. Debian's build of ImGui's Vulkan backend links
// the Vulkan loader; this one uses volk, so that the program starts without a loader.
#pragma once

#include <array>

#include "vulkan_host/objects.h"

struct ImDrawData;

namespace stgs::tools {

class OverlayPainter {
 public:
  static constexpr std::size_t kFrames = 2;  // maximum number of frames in flight

  OverlayPainter() = default;
  OverlayPainter(const OverlayPainter&) = delete;
  OverlayPainter& operator=(const OverlayPainter&) = delete;
  ~OverlayPainter();

  // Uploads the glyphs of the current ImGui context through the queue. `pass` has one colour
  // attachment and must be compatible with every pass given to draw(). The device must outlive
  // this.
  Status create(const DeviceHandles& device, VkRenderPass pass);
  // Records the list into a pass that has begun. Uses the buffers of frame `number` modulo kFrames,
  // whose previous use must be complete.
  Status draw(const ImDrawData& list, std::size_t number, VkCommandBuffer commands);

 private:
  Status make_glyphs();
  Status upload_glyphs(const std::uint8_t* glyphs, std::uint32_t width, std::uint32_t height);
  Status make_set();
  Status make_pipeline(VkRenderPass pass);
  Status upload_lists(const ImDrawData& list, std::size_t frame);
  void bind(const ImDrawData& list, std::size_t frame, VkCommandBuffer commands) const;

  const DeviceHandles* device_ = nullptr;
  DeviceImage glyphs_;
  VkImageView glyph_view_ = VK_NULL_HANDLE;
  VkSampler sampler_ = VK_NULL_HANDLE;
  DescriptorSet set_;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  VkPipeline pipeline_ = VK_NULL_HANDLE;
  std::array<MappedBuffer, kFrames> vertices_, indices_;
};

}  // namespace stgs::tools
