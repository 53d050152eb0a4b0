// SPDX-License-Identifier: Apache-2.0
// The pictures that a window shows: the scene, and the overlay over it.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "options.h"
#include "play/overlay_painter.h"
#include "play/window_device.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {

// One thread. The device outlives it.
class Screen {
 public:
  explicit Screen(const WindowDevice& device) : device_(device) {}
  ~Screen();
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  // Once, with an ImGui context whose glyphs are made.
  Status create(Size size);

  // A picture to be drawn. Its image is given in any layout once `free` is signalled, which
  // whoever draws the scene waits for, and taken in `after` of VulkanImage.
  struct Picture {
    player::VulkanImage image;
    VkSemaphore free;
  };
  // The next one, of about `size` pixels. Nothing where the window has changed at this moment, has
  // no size, or is not shown; try again. kUnsupported where the window's images cannot be drawn in.
  Result<std::optional<Picture>> begin(Size size);
  // Whether what is shown can be copied.
  bool can_copy() const { return can_copy_; }
  // Draws `list` over the scene, or over black where `has_scene` is false, and shows it. Where
  // `copy` is set it gets what is shown, for which this waits; kUnsupported unless can_copy().
  Status end(const ImDrawData& list, bool has_scene, encoder::Image8* copy);

 private:
  // While it is on its way.
  struct Frame {
    VkCommandPool pool = VK_NULL_HANDLE;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    VkFence ended = VK_NULL_HANDLE;
    VkSemaphore free = VK_NULL_HANDLE;
  };
  struct Target {
    VkImage image = VK_NULL_HANDLE;
    VkImageView view = VK_NULL_HANDLE;
    VkFramebuffer framebuffer = VK_NULL_HANDLE;
    VkSemaphore drawn = VK_NULL_HANDLE;
  };

  VkDevice handle() const { return device_.device().device; }
  Status choose_format();
  Status make_passes();
  Status make_frames();
  Status make_swapchain(Size size);
  Status make_targets();
  void drop_targets();
  Status record(const ImDrawData& list, bool has_scene, bool copied);
  void record_copy(VkCommandBuffer commands) const;
  encoder::Image8 copied() const;

  const WindowDevice& device_;
  VkSurfaceFormatKHR format_{};
  std::array<VkRenderPass, 2> passes_{};  // over black, over the scene
  OverlayPainter painter_;
  std::array<Frame, OverlayPainter::kFrames> frames_;
  std::size_t number_ = 0;  // of the frame
  VkSwapchainKHR swapchain_ = VK_NULL_HANDLE;
  VkExtent2D extent_{};
  Size wanted_;
  bool outdated_ = true, can_copy_ = false;
  std::vector<Target> targets_;
  std::uint32_t current_ = 0;  // of targets_
  MappedBuffer copy_;
};

}  // namespace stgs::tools
