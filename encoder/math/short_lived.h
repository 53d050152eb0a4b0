// SPDX-License-Identifier: Apache-2.0
// Learning rates of short-lived primitives, in the same subset of C++, CUDA and GLSL as
// format/math.
#ifndef STGS_ENCODER_MATH_SHORT_LIVED_H
#define STGS_ENCODER_MATH_SHORT_LIVED_H

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

STGS_MATH_BEGIN

// Limits the rates of primitives with a lifespan of a frame.
const float kMaxShortLivedFactor = 3.0f;

// A primitive is updated only by steps whose view shows it. One with a lifespan of a tenth of the
// clip gets a tenth of the steps, which is too few in a short run unless its steps are longer.
struct ShortLivedRules {
  float half_clip;  // half the clip's length, ticks
  float power;      // at least 0; 0: all primitives have the same rates
};

// The factor of a primitive's learning rates, 1 to kMaxShortLivedFactor: the length of the clip
// over that of the primitive's support at full opacity, to the power.
STGS_FN float short_lived_factor(float sigma, float radius, ShortLivedRules rules) {
  if (rules.power <= 0.0f) return 1.0f;
  float half_width = support_half_width(1.0f, sigma, radius, kAlphaThreshold);
  if (half_width >= rules.half_clip) return 1.0f;
  return smaller(kMaxShortLivedFactor, exp(rules.power * log(rules.half_clip / half_width)));
}

STGS_MATH_END

#endif
