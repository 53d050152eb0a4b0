// SPDX-License-Identifier: Apache-2.0
// Motion and visibility over time (spec/representation.md, 2; paper eq. 1 and 2). Times, sigma and
// radius are in ticks of the time base; for a trainer a tick is one frame.
#ifndef STGS_FORMAT_MATH_LIFESPAN_H
#define STGS_FORMAT_MATH_LIFESPAN_H

#include "lang.h"

STGS_MATH_BEGIN

// The coupled lifespan f(sigma, r) that divides the velocity, at least 2 (paper eq. 1).
STGS_FN float lifespan_modulation(float sigma, float radius) {
  float span = sigma + radius;
  return 1.0f + larger(1.0f, span * span);
}

// Position at dt = t - T for the effective velocity u = v / f, scene units per tick (paper eq. 1).
STGS_FN Vec3 position_at(Vec3 position, Vec3 u, float dt) {
  return vec3_of(position.x + u.x * dt, position.y + u.y * dt, position.z + u.z * dt);
}

// Flat-top visibility l(t) in [0,1] at dt = t - T; sigma > 0, radius >= 0 (paper eq. 2).
STGS_FN float visibility(float dt, float sigma, float radius) {
  float beyond = abs(dt) - radius;
  if (beyond <= 0.0f) return 1.0f;
  float x = beyond / sigma;
  return exp(-x * x);
}

// Half width of the support {t : O l(t) >= threshold} around T, or -1 if it is empty. From eq. 2:
// |t - T| <= r + sigma sqrt(-ln(threshold / O)).
STGS_FN float support_half_width(float opacity, float sigma, float radius, float threshold) {
  if (opacity < threshold) return -1.0f;
  return radius + sigma * sqrt(larger(0.0f, log(opacity / threshold)));
}

// Times, in ticks, at which a primitive can be visible; empty if begin > end.
struct Support {
  float begin, end;
};

// Later than any time. The support of a primitive that is never visible is [kNever, -kNever].
const float kNever = 3e38f;

// The support around the centre `time`, widened by the rounding error of single precision, so that
// candidate lists never exclude a primitive that the exact test would accept.
STGS_FN Support candidate_support(float opacity, float time, float sigma, float radius,
                                  float threshold) {
  float half_width = support_half_width(opacity + 1e-5f * threshold, sigma, radius, threshold);
  float margin = 1e-5f * (abs(time) + abs(half_width)) + 1e-5f;
  Support s;
  s.begin = half_width < 0.0f ? kNever : time - half_width - margin;
  s.end = half_width < 0.0f ? -kNever : time + half_width + margin;
  return s;
}

// The time centre T and the radius of a primitive, ticks.
struct Lifespan {
  float time, radius;
};

// The lifespan of a primitive that ends at `end`, if that is before T + r. Its flat top begins as
// before, but not before its part, at `begin`. The position moves with T: position_at().
STGS_FN Lifespan ended_lifespan(float time, float radius, float begin, float end) {
  float first = larger(time - radius, begin);
  float last = larger(end, first);
  Lifespan l;
  l.time = time;
  l.radius = radius;
  if (!(last < time + radius)) return l;
  l.time = first + 0.5f * (last - first);
  l.radius = last - l.time;
  return l;
}

STGS_MATH_END

#endif
