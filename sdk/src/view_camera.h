// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "stgs/format/scene_file.h"
#include "stgs/stgs.h"

namespace stgs::sdk {

// Returns the camera of a view as files store it, without near plane, background and fovea.
inline StartCamera camera_of(const stgs_view& view) {
  StartCamera camera;
  std::copy_n(view.rotation, 9, camera.rotation);
  std::copy_n(view.translation, 3, camera.translation);
  camera.fx = view.fx;
  camera.fy = view.fy;
  camera.cx = view.cx;
  camera.cy = view.cy;
  camera.width = view.width;
  camera.height = view.height;
  return camera;
}

inline void set_camera(const StartCamera& camera, stgs_view& view) {
  std::copy_n(camera.rotation, 9, view.rotation);
  std::copy_n(camera.translation, 3, view.translation);
  view.fx = camera.fx;
  view.fy = camera.fy;
  view.cx = camera.cx;
  view.cy = camera.cy;
  view.width = camera.width;
  view.height = camera.height;
}

}  // namespace stgs::sdk
