// SPDX-License-Identifier: Apache-2.0
// What is drawn over the scene: how it plays, what it costs, and the controls.
#pragma once

#include <string>
#include <vector>

#include "options.h"
#include "play/playback.h"
#include "stgs/player/renderer.h"

namespace stgs::tools {

struct OverlayFacts {
  std::string device;
  Size size;
  double fps = 0, frame_ms = 0;  // of the window, of late
  player::RenderStats stats;     // of the last frame that the device has told of
  std::vector<std::string> notices;
};

// In ImGui's frame. What the viewer does with the controls goes to `playback`.
void draw_overlay(Playback& playback, const OverlayFacts& facts);
// While there is nothing to play yet.
void draw_opening(const std::string& file);

}  // namespace stgs::tools
