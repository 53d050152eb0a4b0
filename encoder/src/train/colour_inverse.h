// SPDX-License-Identifier: Apache-2.0
// The inverse of a colour map, shared by the CPU and CUDA in the style of format/math.
#pragma once

#include <cmath>

#include "stgs/format/math/surface.h"

namespace stgs::encoder {

// Returns the colour that a map (ColourMap: 3 x 3 row-major, then the offset) takes to `colour`, or
// `colour` itself if the map is nearly singular.
STGS_FN math::Vec3 before_colour_map(const float* map, math::Vec3 colour) {
  const math::Vec3 a = math::vec3_of(map[0], map[3], map[6]);  // columns
  const math::Vec3 b = math::vec3_of(map[1], map[4], map[7]);
  const math::Vec3 c = math::vec3_of(map[2], map[5], map[8]);
  const math::Vec3 bc = math::cross3(b, c), ca = math::cross3(c, a), ab = math::cross3(a, b);
  const float determinant = math::dot3(a, bc);
  if (!(std::abs(determinant) > 1e-3f)) return colour;
  const math::Vec3 rest = math::vec3_of(colour.x - map[9], colour.y - map[10], colour.z - map[11]);
  return math::vec3_of(math::dot3(bc, rest) / determinant, math::dot3(ca, rest) / determinant,
                       math::dot3(ab, rest) / determinant);
}

}  // namespace stgs::encoder
