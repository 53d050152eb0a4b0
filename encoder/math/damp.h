// SPDX-License-Identifier: Apache-2.0
// What becomes of a primitive's velocity v where a training step has changed its lifespan, in the
// same subset of C++, CUDA and GLSL as format/math.
#ifndef STGS_ENCODER_MATH_DAMP_H
#define STGS_ENCODER_MATH_DAMP_H

#include "math/grad.h"

STGS_MATH_BEGIN

// What lives long stands still unless its motion earns its keep: Adam's steps are a random walk
// where nothing moves, and what covers a whole clip would drift with it. A lifespan that grows
// while the motion stays has v grow with f, to more than steps of a length would ever bring to
// rest.
struct DampingRules {
  float half_width;  // half width of the support, ticks, beyond which v shrinks
  float shrink;  // |v| that a step takes off there, down to 0; scene units a frame; 0: v is kept
  float share;   // of |v|, which a step takes off where that is more; 0 to 1
};

// v after a step of Adam that left the lifespan sigma, r, whose modulation f is `ratio` times what
// it was before; 1 where v is not modulated. The motion u = v / f stays as it was, else each change
// of sigma or r would change it too, which keeps lifespans from being learnt; then v shrinks, a
// proximal step of an L1 penalty on |v|, and fast where |v| is large. How long is told by what is
// seen of full opacity, not by sigma + r: a flat top ends with r, where a sigma as long is seen for
// more than twice as long.
STGS_FN Vec3 damped_velocity(Vec3 v, float ratio, float sigma, float radius, DampingRules rules) {
  Vec3 kept = vec3_scale(v, ratio);
  float seen = support_half_width(1.0f, sigma, radius, kAlphaThreshold);
  if (seen <= rules.half_width || rules.shrink <= 0.0f) return kept;
  float length = sqrt(dot3(kept, kept));
  if (length <= rules.shrink) return vec3_of(0.0f, 0.0f, 0.0f);
  return vec3_scale(kept, 1.0f - larger(rules.share, rules.shrink / length));
}

STGS_MATH_END

#endif
