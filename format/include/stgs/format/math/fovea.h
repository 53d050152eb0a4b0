// SPDX-License-Identifier: Apache-2.0
// Drawing at half resolution away from where the eye looks: there a tile is one of a picture of
// half the size, whose pixels stand for squares of 2 x 2. No part of the format.
#ifndef STGS_FORMAT_MATH_FOVEA_H
#define STGS_FORMAT_MATH_FOVEA_H

#include "lang.h"

STGS_MATH_BEGIN

// Squares of so many pixels, of 2 x 2 tiles, are drawn at one resolution.
const int kFoveaSquare = 32;

// Whether all of the square of kFoveaSquare pixels from (left, top) on is farther than `radius`
// pixels from the centre.
STGS_FN bool beyond_fovea(Vec2 centre, float radius, float left, float top) {
  float side = float(kFoveaSquare);
  float dx = larger(0.0f, larger(left - centre.x, centre.x - left - side));
  float dy = larger(0.0f, larger(top - centre.y, centre.y - top - side));
  return dx * dx + dy * dy > radius * radius;
}

// A splat on the picture of half the size.
struct HalvedSplat {
  Sym2 conic;   // 1/pixels^2 of that picture
  float scale;  // of its opacity, in (0, 1]
};

// Averaged over the squares: its covariance grows by that of four pixels about their centre, 1/4,
// and what it covers in all stays.
STGS_FN HalvedSplat halved_splat(Sym2 conic) {
  float more = 0.25f;
  float det = larger(0.0f, conic.xx * conic.yy - conic.xy * conic.xy);  // of long ones rounded away
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
