// SPDX-License-Identifier: Apache-2.0
// A projected Gaussian as renderers blend it: its bounding box, and its alpha as a power of 2
// (spec/representation.md, 3 and 5).
#ifndef STGS_FORMAT_MATH_SCREEN_SPLAT_H
#define STGS_FORMAT_MATH_SCREEN_SPLAT_H

#include "blend.h"
#include "project.h"

STGS_MATH_BEGIN

const float kLog2E = 1.44269504f;           // log2(e)
const float kLog2Threshold = -7.99435344f;  // log2(kAlphaThreshold)
// Slightly above log2(kAlphaMax): regardless of the rounding of 2^x, two such splats end a pixel,
// as two of kAlphaMax do.
const float kLog2AlphaMax = -0.014499f;
// Added to the limit of the squared distance in the tests which tiles the ellipse of a splat meets,
// in units of log2; raster/bin.cpp adds 1e-4 to its double.
const float kLimitSlack = 0.75e-4f;

// Log2 of a splat's falloff at pixel offset (dx, dy): dx (xx dx + xy dy) + yy dy^2.
struct Falloff {
  float xx, xy, yy;
};

STGS_FN Falloff falloff_of(Sym2 conic) {
  Falloff f;
  f.xx = -0.5f * kLog2E * conic.xx;
  f.xy = -kLog2E * conic.xy;
  f.yy = -0.5f * kLog2E * conic.yy;
  return f;
}

// The inverse of falloff_of().
STGS_FN Sym2 conic_of(Falloff f) {
  Sym2 conic;
  conic.xx = f.xx * (-2.0f / kLog2E);
  conic.xy = f.xy * (-1.0f / kLog2E);
  conic.yy = f.yy * (-2.0f / kLog2E);
  return conic;
}

// A visible splat. Log2 of its alpha, before the limit of kAlphaMax, is peak + min(0, falloff); a
// positive falloff is a rounding error. Renderers store it as three vectors of four floats.
struct STGS_ALIGNED(16) ScreenSplat {
  Vec2 mean;  // pixels
  Falloff falloff;
  float peak;   // log2 of its opacity
  Vec2 extent;  // half size of its bounding box, pixels
  Vec3 colour;  // sRGB-encoded, >= 0
  float depth;  // camera z
};

// The bounding box of a splat around its mean.
struct SplatBox {
  Vec2 extent;  // half size, pixels; beyond it, alpha is less than kAlphaThreshold
  int visible;  // 0: the splat is outside the image or not finite; extent is then unspecified
};

// The box of a projected Gaussian. It is not visible if its opacity is below kAlphaThreshold.
STGS_FN SplatBox splat_box(PinholeCamera camera, Projection p, float opacity) {
  float elongation = elongation_of(p);
  Vec2 extent = splat_extent(p.covariance, opacity, kAlphaThreshold);
  float slack = extent_slack(elongation);
  SplatBox box;
  box.extent = vec2_of(extent.x * slack, extent.y * slack);
  bool finite = is_finite(elongation) && is_finite(p.conic.xy) && is_finite(p.depth);
  bool visible = p.visible != 0 && finite && opacity >= kAlphaThreshold &&
                 !outside_image(camera, p.mean, box.extent);
  box.visible = visible ? 1 : 0;
  return box;
}

// The splat of a projected Gaussian with a visible box of half size `extent`.
STGS_FN ScreenSplat screen_splat(Projection p, Vec2 extent, float opacity, Vec3 colour) {
  ScreenSplat s;
  s.mean = p.mean;
  s.falloff = falloff_of(p.conic);
  s.peak = log2(opacity);
  s.extent = extent;
  s.colour = colour;
  s.depth = p.depth;
  return s;
}

STGS_MATH_END

#endif
