// SPDX-License-Identifier: Apache-2.0
// The alpha law and front-to-back compositing (spec/representation.md, 5).
#ifndef STGS_FORMAT_MATH_BLEND_H
#define STGS_FORMAT_MATH_BLEND_H

#include "lang.h"

STGS_MATH_BEGIN

// o_th of the paper: less opaque contributions, in time or on screen, are not rendered.
const float kAlphaThreshold = 1.0f / 255.0f;
const float kAlphaMax = 0.99f;
// ln(1 / kAlphaThreshold), rounded up: bounds the visible range in time; twice it bounds the range
// in space.
const float kReachMax = 5.55f;
// A pixel is finished before the splat that would reduce its transmittance below this.
const float kTransmittanceMin = 1e-4f;

// The sigmoid: opacity of a logit.
STGS_FN float opacity_of(float logit) {
  return 1.0f / (1.0f + exp(-logit));
}

// d' conic d / 2.
STGS_FN float splat_power(Sym2 conic, float dx, float dy) {
  return 0.5f * (conic.xx * dx * dx + conic.yy * dy * dy) + conic.xy * dx * dy;
}

// Alpha of a splat of opacity O_s at half squared distance `power`; 0 below kAlphaThreshold. A
// negative distance is a rounding error near the centre of an elongated splat and counts as 0.
STGS_FN float splat_alpha(float opacity, float power) {
  float alpha = smaller(kAlphaMax, opacity * exp(-larger(0.0f, power)));
  return alpha < kAlphaThreshold ? 0.0f : alpha;
}

STGS_MATH_END

#endif
