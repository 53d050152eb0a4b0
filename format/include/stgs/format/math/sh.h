// SPDX-License-Identifier: Apache-2.0
// Real spherical harmonics up to degree 3, in the basis and order of 3DGS (spec/representation.md,
// 4).
#ifndef STGS_FORMAT_MATH_SH_H
#define STGS_FORMAT_MATH_SH_H

#include "lang.h"

STGS_MATH_BEGIN

const int kShMaxDegree = 3;
const int kShMaxCoefficients = 16;

// Factors of the basis functions, named by degree and order; those of order -m are equal.
const float kSh00 = 0.28209479177387814f;
const float kSh1 = 0.4886025119029199f;
const float kSh20 = 0.31539156525252005f;
const float kSh21 = 1.0925484305920792f;
const float kSh30 = 0.3731763325901154f;
const float kSh31 = 0.4570457994644658f;
const float kSh32 = 2.890611442640554f;
const float kSh33 = 0.5900435899266435f;

// Values of the basis functions, degree by degree: 1, 3, 5 and 7 values.
struct ShBasis {
  float v[16];
};

STGS_FN int sh_coefficients(int degree) {
  return (degree + 1) * (degree + 1);
}

// Basis at the unit vector d from the camera centre to the primitive.
STGS_FN ShBasis sh_basis(Vec3 d) {
  float x = d.x;
  float y = d.y;
  float z = d.z;
  float xx = x * x;
  float yy = y * y;
  float zz = z * z;
  ShBasis b;
  b.v[0] = kSh00;
  b.v[1] = -kSh1 * y;
  b.v[2] = kSh1 * z;
  b.v[3] = -kSh1 * x;
  b.v[4] = kSh21 * x * y;
  b.v[5] = -kSh21 * y * z;
  b.v[6] = kSh20 * (2.0f * zz - xx - yy);
  b.v[7] = -kSh21 * x * z;
  b.v[8] = 0.5f * kSh21 * (xx - yy);
  b.v[9] = -kSh33 * y * (3.0f * xx - yy);
  b.v[10] = kSh32 * x * y * z;
  b.v[11] = -kSh31 * y * (4.0f * zz - xx - yy);
  b.v[12] = kSh30 * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
  b.v[13] = -kSh31 * x * (4.0f * zz - xx - yy);
  b.v[14] = 0.5f * kSh32 * z * (xx - yy);
  b.v[15] = -kSh33 * x * (xx - 3.0f * yy);
  return b;
}

// One colour channel from the harmonic sum: shifted by 1/2, not below 0, not clamped above.
STGS_FN float sh_colour(float sum) {
  return larger(0.0f, sum + 0.5f);
}

STGS_MATH_END

#endif
