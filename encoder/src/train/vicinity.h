// SPDX-License-Identifier: Apache-2.0
// Sizes of primitives near the cameras and in the far background.
#pragma once

#include <cmath>

#include "stgs/format/math/lang.h"

namespace stgs::encoder {

// A ball around the content. Beyond it, sizes are judged relative to the distance: the primitives
// of sky and far background are as large as their images, at any distance.
struct Vicinity {
  math::Vec3 centre{0, 0, 0};
  float radius = INFINITY;  // scene units
};

// Returns the factor on size limits at a position: 1 within the vicinity, larger beyond it.
STGS_FN float size_factor(const Vicinity& vicinity, math::Vec3 position) {
  const float x = position.x - vicinity.centre.x, y = position.y - vicinity.centre.y,
              z = position.z - vicinity.centre.z;
  return math::larger(1.0f, std::sqrt(x * x + y * y + z * z) / vicinity.radius);
}

inline bool is_far(const Vicinity& vicinity, const float position[3]) {
  return size_factor(vicinity, {position[0], position[1], position[2]}) > 1.0f;
}

}  // namespace stgs::encoder
