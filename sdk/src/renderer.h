// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <span>
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

// A scene to draw and a moment are such that can be drawn.
Outcome check_moment(const stgs_scene* scene, double seconds);
// The caller's views, checked, into renderer.views.
Outcome take_views(stgs_renderer& renderer, const stgs_view* views, std::uint32_t count);

using Pictures = std::array<stgs_image, STGS_MAX_VIEWS>;
// The arguments of a call that draws into pictures, checked: the views into renderer.views, as many
// of the pictures into `known`.
Outcome take_render(stgs_renderer& renderer, const stgs_scene* scene, double seconds,
                    const stgs_view* views, const stgs_image* pictures, std::uint32_t count,
                    Pictures& known);
// Draws renderer.views; the pictures stay in the backend.
Outcome draw(stgs_renderer& renderer, stgs_scene& scene, double seconds);

}  // namespace stgs::sdk
