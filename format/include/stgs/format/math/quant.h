// SPDX-License-Identifier: Apache-2.0
// Rounding of attributes to the values that a decoder reconstructs (spec 8.5), for training with
// quantisation in the loop. Steps are multiplier * 2^exponent, exact in binary32.
#ifndef STGS_FORMAT_MATH_QUANT_H
#define STGS_FORMAT_MATH_QUANT_H

#include "stgs/format/math/lang.h"

STGS_MATH_BEGIN

// Returns the multiple of the step nearest to x, the greater of two.
STGS_FN float rounded_to(float x, float step) {
  return step * floor(x / step + 0.5f);
}

STGS_FN Vec3 rounded3(Vec3 v, float step) {
  return vec3_of(rounded_to(v.x, step), rounded_to(v.y, step), rounded_to(v.z, step));
}

// As rounded_to(), but 0 for fewer than `zone` steps.
STGS_FN float rounded_from(float x, float step, float zone) {
  return abs(x) < zone * step ? 0.0f : rounded_to(x, step);
}

// Returns the factor of the step of displacements over a lifespan, to give that of the velocity
// (spec 8.6): the greatest power of two with a product of at most 1 with the greater of both parts
// of the lifespan. Radius is stored plus 1.
STGS_FN float displacement_scale(float sigma, float radius, float part_ticks) {
  const float lifespan = smaller(larger(radius + 1.0f, 2.0f * sigma), part_ticks);
  float scale = 1.0f;
  for (int k = 0; k < 32 && lifespan * scale >= 2.0f; ++k) scale *= 0.5f;
  for (int k = 0; k < 32 && lifespan * scale < 1.0f; ++k) scale *= 2.0f;
  return scale;
}

// Returns the factor, a power of two, of the step of the rotation of a Gaussian with these log
// scales (spec 8.8): that of a nearly round one is hard to see.
STGS_FN float rotation_step_factor(Vec3 log_scale) {
  const float high = larger(larger(log_scale.x, log_scale.y), log_scale.z);
  const float length = high - smaller(smaller(log_scale.x, log_scale.y), log_scale.z);
  if (length < 0.125f) return 8.0f;
  if (length < 0.5f) return 4.0f;
  if (length < 1.25f) return 2.0f;
  if (length < 2.375f) return 1.0f;
  if (length < 3.75f) return 0.5f;
  return length < 5.0f ? 0.25f : 0.125f;
}

// Returns the unit quaternion with w > 0 and the vector part of q in steps (spec 8.7); q itself
// if that leaves nothing for w. `log_scale`: rounded.
STGS_FN Quat rounded_rotation(Quat q, float step, Vec3 log_scale) {
  const float own = smaller(step * rotation_step_factor(log_scale), 0.5f);
  const float square = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
  const float unit = (q.w < 0.0f ? -1.0f : 1.0f) / sqrt(square);
  Quat out;
  out.x = rounded_to(q.x * unit, own);
  out.y = rounded_to(q.y * unit, own);
  out.z = rounded_to(q.z * unit, own);
  const float rest = 1.0f - (out.x * out.x + out.y * out.y + out.z * out.z);
  if (!(rest > 0.0f)) return q;
  out.w = sqrt(rest);
  return out;
}

// Returns luma and two chroma of a colour (spec 8.5, the inverse).
STGS_FN Vec3 luma_chroma(Vec3 rgb) {
  return vec3_of(0.25f * (rgb.x + 2.0f * rgb.y + rgb.z), 0.5f * (rgb.x - rgb.z),
                 0.25f * (2.0f * rgb.y - rgb.x - rgb.z));
}

// Returns the colour whose luma and chroma are those of an RGB triple in steps, and 0 below `zone`
// steps (spec 8.5).
STGS_FN Vec3 rounded_colour(Vec3 rgb, float step, float zone) {
  const Vec3 v = luma_chroma(rgb);
  const float y = rounded_from(v.x, step, zone);
  const float o = rounded_from(v.y, step, zone);
  const float g = rounded_from(v.z, step, zone);
  return vec3_of(y - g + o, y + g, y - g - o);
}

// Returns the degree of an SH coefficient.
STGS_FN int sh_band_of(int coefficient) {
  return coefficient < 1 ? 0 : coefficient < 4 ? 1 : coefficient < 9 ? 2 : 3;
}

STGS_FN float sign_of(float x) {
  return x > 0.0f ? 1.0f : x < 0.0f ? -1.0f : 0.0f;
}

// Returns the gradient, by an RGB triple, of luma |y| + chroma (|o| + |g|).
STGS_FN Vec3 colour_rate_grad(Vec3 rgb, float luma, float chroma) {
  const Vec3 v = luma_chroma(rgb);
  const float y = 0.25f * luma * sign_of(v.x);
  const float o = 0.5f * chroma * sign_of(v.y);
  const float g = 0.25f * chroma * sign_of(v.z);
  return vec3_of(y + o - g, 2.0f * (y + g), y - o - g);
}

STGS_MATH_END

#endif
