// SPDX-License-Identifier: Apache-2.0
// The lens of a training camera as far as it differs from a pinhole, in the same subset of C++,
// CUDA and GLSL as grad.h.
#ifndef STGS_ENCODER_MATH_LENS_H
#define STGS_ENCODER_MATH_LENS_H

#include "stgs/format/math/project.h"

STGS_MATH_BEGIN

// Small residuals of an image that `prepare` has undistorted.
struct Lens {
  float distortion;  // k: (x/z, y/z) appears at (1 + k r^2) (x/z, y/z), r its length
  float vignetting;  // v: colours appear times 1 + v q^2, q: see lens_radius2
};

// Returns the squared distance of a pixel position from the principal point, over that of a corner
// of the image from its centre; at most 1.
STGS_FN float lens_radius2(PinholeCamera camera, Vec2 pixel) {
  float x = pixel.x - camera.cx;
  float y = pixel.y - camera.cy;
  float w = camera.width;
  float h = camera.height;
  return clamped(4.0f * (x * x + y * y) / (w * w + h * h), 0.0f, 1.0f);
}

// Returns the position through the lens of content that a pinhole has at `pixel`.
STGS_FN Vec2 through_lens(PinholeCamera camera, Lens lens, Vec2 pixel) {
  float x = (pixel.x - camera.cx) / camera.fx;
  float y = (pixel.y - camera.cy) / camera.fy;
  float factor = 1.0f + lens.distortion * (x * x + y * y);
  Vec2 out;
  out.x = camera.cx + camera.fx * factor * x;
  out.y = camera.cy + camera.fy * factor * y;
  return out;
}

STGS_MATH_END

#endif
