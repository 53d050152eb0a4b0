// SPDX-License-Identifier: Apache-2.0
// Conversion of blended colours to sRGB with the primaries of BT.709 (spec 4.4).
#ifndef STGS_FORMAT_MATH_COLOUR_H
#define STGS_FORMAT_MATH_COLOUR_H

#include "stgs/format/math/lang.h"

STGS_MATH_BEGIN

// Code points of ITU-T H.273.
const int kPrimariesBt709 = 1, kPrimariesBt2020 = 9, kPrimariesP3 = 12;
const int kTransferBt709 = 1, kTransferLinear = 8, kTransferSrgb = 13;

// How colours are encoded: primaries + 256 * transfer function; 0: as they are output.
STGS_FN int colour_encoding(int primaries, int transfer) {
  const bool known =
      (primaries == kPrimariesBt709 || primaries == kPrimariesBt2020 ||
       primaries == kPrimariesP3) &&
      (transfer == kTransferBt709 || transfer == kTransferLinear || transfer == kTransferSrgb);
  const bool is_output = primaries == kPrimariesBt709 && transfer == kTransferSrgb;
  return known && !is_output ? primaries + 256 * transfer : 0;
}

STGS_FN float power_of(float x, float exponent) {
  return x > 0.0f ? exp(exponent * log(x)) : 0.0f;
}

// Undoes a transfer function. Values below 0 become 0.
STGS_FN float linear_of(float x, int transfer) {
  if (x <= 0.0f) return 0.0f;
  if (transfer == kTransferLinear) return x;
  if (transfer == kTransferBt709)
    return x < 0.081f ? x / 4.5f : power_of((x + 0.099f) / 1.099f, 1.0f / 0.45f);
  return x <= 0.04045f ? x / 12.92f : power_of((x + 0.055f) / 1.055f, 2.4f);
}

STGS_FN float srgb_of(float x) {
  const float v = clamped(x, 0.0f, 1.0f);
  return v <= 0.0031308f ? 12.92f * v : 1.055f * power_of(v, 1.0f / 2.4f) - 0.055f;
}

// Returns a linear colour with these primaries in those of BT.709.
STGS_FN Vec3 to_bt709(Vec3 c, int primaries) {
  if (primaries == kPrimariesBt2020) {
    return vec3_of(1.6604910f * c.x - 0.5876411f * c.y - 0.0728499f * c.z,
                   -0.1245505f * c.x + 1.1328999f * c.y - 0.0083494f * c.z,
                   -0.0181508f * c.x - 0.1005789f * c.y + 1.1187297f * c.z);
  }
  if (primaries == kPrimariesP3) {
    return vec3_of(1.2249402f * c.x - 0.2249402f * c.y, -0.0420570f * c.x + 1.0420570f * c.y,
                   -0.0196376f * c.x - 0.0786361f * c.y + 1.0982736f * c.z);
  }
  return c;
}

// Converts a colour of this encoding (colour_encoding()) to sRGB.
STGS_FN Vec3 displayed(Vec3 c, int encoding) {
  if (encoding == 0) return c;
  const int primaries = encoding % 256, transfer = encoding / 256;
  const Vec3 linear = to_bt709(
      vec3_of(linear_of(c.x, transfer), linear_of(c.y, transfer), linear_of(c.z, transfer)),
      primaries);
  return vec3_of(srgb_of(linear.x), srgb_of(linear.y), srgb_of(linear.z));
}

STGS_MATH_END

#endif
