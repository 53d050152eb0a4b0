// SPDX-License-Identifier: Apache-2.0
// Moves the camera and controls playback by the mouse and keyboard of the player window.
#pragma once

#include "play/camera_control.h"
#include "play/playback.h"
#include "play/window.h"

namespace stgs::tools {

// Carries out the control of a key, if it has one.
void control_playback(Playback& playback, const KeyPress& press);
// Moves the camera by the mouse. Returns whether a button is held.
bool drag_camera(CameraControl& camera, Window& window);
// Moves the camera by the keys that are held, for `passed` seconds. Returns whether one is.
bool fly_camera(CameraControl& camera, const Window& window, double passed);

}  // namespace stgs::tools
