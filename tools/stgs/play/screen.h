// SPDX-License-Identifier: Apache-2.0
// The swapchain of a window, with the scene and the overlay over it.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "options.h"
#include "play/overlay_painter.h"
#include "play/window_device.h"
#include "stgs/encoder/prepared_capture.h"

namespace stgs::tools {

// Not thread-safe. The device must outlive this.
class Screen {
 public:
  explicit Screen(const WindowDevice& device) : device_(device) {}
  ~Screen();
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  // Call once, after the glyphs of the current ImGui context have been built.
  Status create(Size size);

  // An acquired swapchain image. The renderer of the scene waits for `acquired`, finds the image in
  // any layout, and leaves it in image.final_layout.
  struct Acquired {
    stgs_vulkan_image image{};
    VkSemaphore acquired = VK_NULL_HANDLE;
  };
  // Acquires the next image, of about `size` pixels. Returns nothing if the window has just
  // changed, has no area, or is hidden; try again. kUnsupported if the images cannot be rendered
  // to.
  Result<std::optional<Acquired>> begin(Size size);
  // Returns whether end() can copy the image.
  bool can_copy() const { return can_copy_; }
  // Renders `list` over the scene, or over black if `has_scene` is false, and presents the image.
  // If `copy` is not null, blocks until the image is complete and copies it; kUnsupported unless
  // can_copy().
  Status end(const ImDrawData& list, bool has_scene, encoder::Image8* copy);

 private:
  // The resources of a frame in flight.
  struct Frame {
    VkCommandPool pool = VK_NULL_HANDLE;
    VkCommandBuffer commands = VK_NULL_HANDLE;
    VkFence completed = VK_NULL_HANDLE;
    VkSemaphore acquired = VK_NULL_HANDLE;
  };
  struct Target {
    VkImage image = VK_NULL_HANDLE;
    VkImageView view = VK_NULL_HANDLE;
    VkFramebuffer framebuffer = VK_NULL_HANDLE;
    VkSemaphore rendered = VK_NULL_HANDLE;
  };

  VkDevice handle() const { return device_.device().device; }
  Status choose_format();
  Status make_passes();
  Status make_frames();
  Status make_swapchain(Size size);
  Status make_targets();
  void destroy_targets();
  Status record(const ImDrawData& list, bool has_scene, bool copied);
  void record_copy(VkCommandBuffer commands) const;
  encoder::Image8 copied() const;

  const WindowDevice& device_;
  VkSurfaceFormatKHR format_{};
  std::array<VkRenderPass, 2> passes_{};  // [0] clears to black, [1] keeps the scene
  OverlayPainter painter_;
  std::array<Frame, OverlayPainter::kFrames> frames_;
  std::size_t number_ = 0;  // of the current frame
  VkSwapchainKHR swapchain_ = VK_NULL_HANDLE;
  VkExtent2D extent_{};
  Size requested_;
  bool outdated_ = true, can_copy_ = false;
  std::vector<Target> targets_;
  std::uint32_t current_ = 0;  // index into targets_
  MappedBuffer copy_;
};

}  // namespace stgs::tools
