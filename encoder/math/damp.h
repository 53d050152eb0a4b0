// SPDX-License-Identifier: Apache-2.0
// Damps a primitive's velocity v after a training step has changed its lifespan, in the same subset
// of C++, CUDA and GLSL as format/math.
#ifndef STGS_ENCODER_MATH_DAMP_H
#define STGS_ENCODER_MATH_DAMP_H

#include "math/grad.h"

STGS_MATH_BEGIN

// Long-lived primitives become static unless their motion reduces the loss. Without damping, Adam's
// steps are a random walk where nothing moves, and primitives that cover a complete clip drift. A
// constant `shrink` alone does not suffice: while a lifespan grows and the motion remains, v grows
// with f, faster than steps of constant length reduce it.
struct DampingRules {
  float half_width;  // half width of the support, ticks, beyond which v shrinks
  float shrink;      // |v| removed per step there, down to 0; scene units per frame; 0: no damping
  float share;       // fraction of |v|, 0 to 1, removed per step if that is more
};

// Returns v after an Adam step that left the lifespan sigma, r. `ratio` is the modulation f over
// its value before the step; 1 if v is not modulated.
// 1. Scales v by `ratio`, which preserves the motion u = v / f. Otherwise every change of sigma or
// r
//    would change the motion too, and lifespans could not be learnt.
// 2. Shrinks v of a long-lived primitive: a proximal step of an L1 penalty on |v|, accelerated for
//    large |v|. The lifespan is the support at full opacity rather than sigma + r, because a flat
//    top ends at r, but an equal sigma stays visible for more than twice as long.
STGS_FN Vec3 damped_velocity(Vec3 v, float ratio, float sigma, float radius, DampingRules rules) {
  Vec3 scaled = vec3_scale(v, ratio);
  float support = support_half_width(1.0f, sigma, radius, kAlphaThreshold);
  if (support <= rules.half_width || rules.shrink <= 0.0f) return scaled;
  float length = sqrt(dot3(scaled, scaled));
  if (length <= rules.shrink) return vec3_of(0.0f, 0.0f, 0.0f);
  return vec3_scale(scaled, 1.0f - larger(rules.share, rules.shrink / length));
}

STGS_MATH_END

#endif
