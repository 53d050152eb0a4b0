// SPDX-License-Identifier: Apache-2.0
// Renders a scene into the images of the window, on its device.
#pragma once

#include <memory>

#include "play/screen.h"
#include "scene_renderer.h"

namespace stgs::tools {

// Not thread-safe. The device must outlive this.
class FrameRenderer {
 public:
  static Result<std::unique_ptr<FrameRenderer>> make(const WindowDevice& device);
  // Used by make().
  explicit FrameRenderer(RendererPtr renderer) : renderer_(std::move(renderer)) {}

  // Submits the view of a time, seconds. Returns the number of the frame, counted from 1.
  Result<std::uint64_t> submit(stgs_scene* scene, double seconds, const stgs_view& view,
                               const Screen::Acquired& to);
  // Returns the last frame that completed, without waiting.
  Result<stgs_vulkan_progress> last_completed() const;
  // Blocks until all frames have completed.
  Status wait();

 private:
  Status check(stgs_result result) const;

  RendererPtr renderer_;
};

}  // namespace stgs::tools
