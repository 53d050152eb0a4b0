// SPDX-License-Identifier: Apache-2.0
#include "play/frame_renderer.h"

#include "scene_file.h"

namespace stgs::tools {

Result<std::unique_ptr<FrameRenderer>> FrameRenderer::make(const WindowDevice& device) {
  STGS_ASSIGN(const stgs_vulkan_device lent, device.lent());
  STGS_ASSIGN(RendererPtr renderer,
              create_renderer([&](stgs_renderer_settings& settings, stgs_renderer** out) {
                return stgs_vulkan_renderer_create(&lent, &settings, out);
              }));
  return std::make_unique<FrameRenderer>(std::move(renderer));
}

Status FrameRenderer::check(stgs_result result) const {
  return status_of(result, renderer_.get(), stgs_renderer_error);
}

Result<std::uint64_t> FrameRenderer::submit(stgs_scene* scene, double seconds,
                                            const stgs_view& view, const Screen::Acquired& to) {
  stgs_vulkan_target target;
  STGS_TRY(check(stgs_vulkan_target_defaults(&target, sizeof(target))));
  target.colour = to.image;
  const stgs_vulkan_semaphore wait{to.acquired, 0};
  stgs_vulkan_frame frame;
  STGS_TRY(check(stgs_vulkan_frame_defaults(&frame, sizeof(frame))));
  frame.views = &view;
  frame.targets = &target;
  frame.count = 1;
  frame.wait = &wait;
  frame.wait_count = 1;
  std::uint64_t number = 0;
  STGS_TRY(check(stgs_vulkan_submit(renderer_.get(), scene, seconds, &frame, &number)));
  return number;
}

Result<stgs_vulkan_progress> FrameRenderer::last_completed() const {
  auto progress = sized<stgs_vulkan_progress>();
  STGS_TRY(check(stgs_vulkan_get_progress(renderer_.get(), &progress)));
  return progress;
}

Status FrameRenderer::wait() {
  return check(stgs_vulkan_wait(renderer_.get()));
}

}  // namespace stgs::tools
