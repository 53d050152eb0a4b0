// SPDX-License-Identifier: Apache-2.0
// Foveated rendering: far from the point of gaze, tiles are those of an image of half the size,
// whose pixels stand for 2 x 2 pixels. Not part of the format.
#ifndef STGS_FORMAT_MATH_FOVEA_H
#define STGS_FORMAT_MATH_FOVEA_H

#include "lang.h"

STGS_MATH_BEGIN

// Side of the squares of uniform resolution, pixels; each has 2 x 2 tiles.
const int kFoveaSquare = 32;

// Whether the square of kFoveaSquare pixels with corner (left, top) is entirely farther than
// `radius` pixels from the centre.
STGS_FN bool beyond_fovea(Vec2 centre, float radius, float left, float top) {
  float side = float(kFoveaSquare);
  float dx = larger(0.0f, larger(left - centre.x, centre.x - left - side));
  float dy = larger(0.0f, larger(top - centre.y, centre.y - top - side));
  return dx * dx + dy * dy > radius * radius;
}

// A splat in the image of half the size.
struct HalvedSplat {
  Sym2 conic;   // 1/pixels^2 of that image
  float scale;  // factor on its opacity, in (0, 1]
};

// The splat averaged over squares of 2 x 2 pixels. Its covariance grows by 1/4, the variance of
// four pixels about their centre; its total coverage is preserved.
STGS_FN HalvedSplat halved_splat(Sym2 conic) {
  float more = 0.25f;
  // Rounding can make the determinant of an elongated splat negative.
  float det = larger(0.0f, conic.xx * conic.yy - conic.xy * conic.xy);
  float shrink = 1.0f / (1.0f + more * (conic.xx + conic.yy) + more * more * det);
  HalvedSplat out_splat;
  out_splat.conic.xx = 4.0f * shrink * (conic.xx + more * det);
  out_splat.conic.xy = 4.0f * shrink * conic.xy;
  out_splat.conic.yy = 4.0f * shrink * (conic.yy + more * det);
  out_splat.scale = sqrt(shrink);
  return out_splat;
}

STGS_MATH_END

#endif
