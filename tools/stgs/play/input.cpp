// SPDX-License-Identifier: Apache-2.0
#include "play/input.h"

#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>

namespace stgs::tools {
namespace {

constexpr double kFullTurn = 6.2831853;  // radians per drag over the height of the window
constexpr double kWheelStep = 0.9;       // factor of the distance per wheel step
constexpr double kFlySpeed = 0.5;        // distances to the target per second
constexpr double kFastFactor = 4;        // of kFlySpeed, with the shift key
constexpr double kJumpSeconds = 1;       // of an arrow key with the shift key

}  // namespace

void control_playback(Playback& playback, const KeyPress& press) {
  const double now = playback.seconds();
  switch (press.key) {
    case GLFW_KEY_SPACE:
      return playback.toggle_pause();
    case GLFW_KEY_LEFT:
      return press.shift ? playback.seek(now - kJumpSeconds) : playback.step(-1);
    case GLFW_KEY_RIGHT:
      return press.shift ? playback.seek(now + kJumpSeconds) : playback.step(1);
    case GLFW_KEY_UP:
      return playback.change_rate(1);
    case GLFW_KEY_DOWN:
      return playback.change_rate(-1);
    case GLFW_KEY_HOME:
      return playback.seek(0);
    case GLFW_KEY_END:
      return playback.seek(playback.duration());
    case GLFW_KEY_L:
      return playback.toggle_loop();
    default:
      return;
  }
}

bool drag_camera(CameraControl& camera, Window& window) {
  const ImGuiIO& io = ImGui::GetIO();
  const auto [left, right, middle] = window.take_drags();
  if (io.WantCaptureMouse) return false;
  const double radians = kFullTurn / std::max(io.DisplaySize.y, 1.0f);
  if (left.held) camera.orbit(-radians * left.x, radians * left.y);
  if (right.held) camera.look(radians * right.x, -radians * right.y);
  if (middle.held) {
    const double units = camera.distance() / std::max(io.DisplaySize.y, 1.0f);
    camera.move(-units * middle.x, units * middle.y, 0);
  }
  if (io.MouseWheel != 0) camera.approach(std::pow(kWheelStep, io.MouseWheel));
  return left.held || right.held || middle.held;
}

bool fly_camera(CameraControl& camera, const Window& window, double passed) {
  const auto axis = [&](int plus, int minus) {
    return static_cast<double>(window.is_down(plus)) - static_cast<double>(window.is_down(minus));
  };
  const double right = axis(GLFW_KEY_D, GLFW_KEY_A), up = axis(GLFW_KEY_E, GLFW_KEY_Q),
               forward = axis(GLFW_KEY_W, GLFW_KEY_S);
  if (right == 0 && up == 0 && forward == 0) return false;
  const bool fast = window.is_down(GLFW_KEY_LEFT_SHIFT) || window.is_down(GLFW_KEY_RIGHT_SHIFT);
  const double step = passed * kFlySpeed * camera.distance() * (fast ? kFastFactor : 1);
  camera.move(step * right, step * up, step * forward);
  return true;
}

}  // namespace stgs::tools
