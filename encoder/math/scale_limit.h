// SPDX-License-Identifier: Apache-2.0
// The smallest scale of a primitive that training images can resolve (the 3D filter of
// Mip-Splatting, as a limit), in the same subset of C++, CUDA and GLSL as grad.h.
#ifndef STGS_ENCODER_MATH_SCALE_LIMIT_H
#define STGS_ENCODER_MATH_SCALE_LIMIT_H

#include "stgs/format/math/project.h"

STGS_MATH_BEGIN

// Pixels per scene unit at world point p in a camera's image; 0 if the image does not show it.
STGS_FN float sampling_rate(PinholeCamera camera, Vec3 p) {
  Vec3 c = to_camera(camera, p);
  if (!(c.z >= camera.near_plane)) return 0.0f;
  float iz = 1.0f / c.z;
  Vec2 at = vec2_of(camera.fx * c.x * iz + camera.cx, camera.fy * c.y * iz + camera.cy);
  if (outside_image(camera, at, vec2_of(0.0f, 0.0f))) return 0.0f;
  return larger(camera.fx, camera.fy) * iz;
}

STGS_MATH_END

#endif
