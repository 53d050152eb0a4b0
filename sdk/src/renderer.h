// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
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
  std::unique_ptr<stgs::TaskRunner> tasks;         // null: threads of the library
  stgs::player::VulkanRenderer* vulkan = nullptr;  // `backend` if on the caller's device, else null
  std::vector<stgs::player::View> views;           // of the current call
  std::vector<stgs::player::Frame> frames;
  bool measure = false;
  std::optional<stgs::player::RenderStats> stats;  // of the last stgs_render
};

namespace stgs::sdk {

// Implements the functions that create renderers. `settings` may be null; `make` sets the backend.
stgs_result create_renderer(const stgs_renderer_settings* settings, stgs_renderer** out,
                            const std::function<Outcome(stgs_renderer&, stgs_backend)>& make);

// Checks that the scene is open and the time in its clip, and clamps the time.
Outcome clamp_time(const stgs_scene* scene, double& seconds);
// Copies the caller's views, checked, to renderer.views.
Outcome copy_in_views(stgs_renderer& renderer, const stgs_view* views, std::uint32_t count);

using Images = std::array<stgs_image, STGS_MAX_VIEWS>;
// Checks the arguments of a call that renders into images; clamps the time, and copies the views to
// renderer.views and `count` images to `known`.
Outcome copy_in_arguments(stgs_renderer& renderer, const stgs_scene* scene, double& seconds,
                          const stgs_view* views, const stgs_image* images, std::uint32_t count,
                          Images& known);
// Renders renderer.views; the frames stay in the backend. Sets renderer.stats if it measures.
Outcome render(stgs_renderer& renderer, stgs_scene& scene, double seconds);

}  // namespace stgs::sdk
