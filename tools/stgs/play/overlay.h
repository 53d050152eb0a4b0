// SPDX-License-Identifier: Apache-2.0
// The overlay of the player window: playback status, statistics and controls.
#pragma once

#include <string>
#include <vector>

#include "options.h"
#include "play/playback.h"
#include "play/vulkan.h"

namespace stgs::tools {

struct OverlayState {
  std::string device;
  Size size;
  double fps = 0, frame_ms = 0;  // of the window, recent mean
  stgs_vulkan_progress frame{};  // the last frame that the device has completed
  std::vector<std::string> notices;
};

// Draws the overlay into the current ImGui frame. The controls act on `playback`.
void draw_overlay(Playback& playback, const OverlayState& state);
// Draws the notice that is shown until the file is open.
void draw_opening(const std::string& file);

}  // namespace stgs::tools
