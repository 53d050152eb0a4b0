// SPDX-License-Identifier: Apache-2.0
// What becomes of a primitive's velocity v where a training step has changed its lifespan, in the
// same subset of C++, CUDA and GLSL as format/math.
#ifndef STGS_ENCODER_MATH_SETTLE_H
#define STGS_ENCODER_MATH_SETTLE_H

#include "math/grad.h"

STGS_MATH_BEGIN

// What lives long stands still unless its motion earns its keep: Adam's steps are a random walk
// where nothing moves, and what covers a whole clip would drift with it.
struct SettleRules {
  float still;   // modulation f (paper eq. 1) beyond which v shrinks
  float shrink;  // |v| that a step takes off there, down to 0; scene units a frame
};

// v after a step of Adam that left a lifespan of modulation f, `ratio` times what f was before; 1
// where v is not modulated. The motion u = v / f stays as it was, else each change of sigma or r
// would change it too, which keeps lifespans from being learnt; then v shrinks, a proximal step of
// an L1 penalty on |v|.
STGS_FN Vec3 settled_velocity(Vec3 v, float ratio, float f, SettleRules rules) {
  Vec3 kept = vec3_scale(v, ratio);
  if (f <= rules.still || rules.shrink <= 0.0f) return kept;
  float length = sqrt(dot3(kept, kept));
  if (length <= rules.shrink) return vec3_of(0.0f, 0.0f, 0.0f);
  return vec3_scale(kept, 1.0f - rules.shrink / length);
}

STGS_MATH_END

#endif
