// SPDX-License-Identifier: Apache-2.0
// Axes and positions of cameras, world space.
#pragma once

#include "stgs/encoder/prepared_capture.h"
#include "vector.h"

namespace stgs::tools {

// Returns the axis of a camera: 0 right, 1 down, 2 forward.
inline Vector3 axis_of(const encoder::Camera& camera, int row) {
  const double* r = camera.rotation + 3 * row;
  return {r[0], r[1], r[2]};
}

inline Vector3 position_of(const encoder::Camera& camera) {
  Vector3 position;
  for (int row = 0; row < 3; ++row) {
    position = position - camera.translation[row] * axis_of(camera, row);
  }
  return position;
}

}  // namespace stgs::tools
