// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "stgs/format/scene_file.h"
#include "stgs/stgs.h"

namespace stgs::sdk {

// The camera of a view, as files have it: without near plane, background and fovea.
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

}  // namespace stgs::sdk
