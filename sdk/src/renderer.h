// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "object.h"
#include "stgs/player/renderer.h"
#include "tasks.h"

namespace stgs::player {
class VulkanRenderer;
}

struct stgs_renderer {
  stgs::sdk::LastError error;
  stgs::sdk::Log log;
  std::unique_ptr<stgs::player::Renderer> backend;
  std::unique_ptr<stgs::TaskRunner> tasks;         // null: threads of the library's
  stgs::player::VulkanRenderer* vulkan = nullptr;  // `backend` on a device of the caller's, or null
  std::vector<stgs::player::View> views;           // of a call
  std::vector<stgs::player::Frame> frames;
};

namespace stgs::sdk {

// What a function that makes renderers does. `settings` may be null; `make` sets the backend.
stgs_result create_renderer(const stgs_renderer_settings* settings, stgs_renderer** out,
                            const std::function<Outcome(stgs_renderer&, stgs_backend)>& make);

// A scene to draw, a moment and a number of views are such that can be drawn.
Outcome check_moment(const stgs_scene* scene, double seconds);
Outcome check_view_count(std::uint32_t count);
// The arguments of a call that draws into pictures.
Outcome check_render(const stgs_scene* scene, double seconds, const stgs_view* views,
                     const stgs_picture* pictures, std::uint32_t count);
// `count` views, which have been checked, into renderer.views.
void take_views(stgs_renderer& renderer, const stgs_view* views, std::uint32_t count);
// Draws them; the pictures stay in the backend.
Outcome draw(stgs_renderer& renderer, stgs_scene& scene, double seconds, const stgs_view* views,
             std::uint32_t count);

}  // namespace stgs::sdk
