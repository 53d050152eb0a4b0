// SPDX-License-Identifier: Apache-2.0
// Real spherical harmonics to degree 3, in the basis and order of 3DGS (spec/representation.md, 4).
#ifndef STGS_FORMAT_MATH_SH_H
#define STGS_FORMAT_MATH_SH_H

#include "lang.h"

STGS_MATH_BEGIN

const int kShMaxDegree = 3;
const int kShMaxCoefficients = 16;

// Values of the basis functions, degree by degree: 1, 3, 5, 7 of them.
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
  b.v[0] = 0.28209479177387814f;
  b.v[1] = -0.4886025119029199f * y;
  b.v[2] = 0.4886025119029199f * z;
  b.v[3] = -0.4886025119029199f * x;
  b.v[4] = 1.0925484305920792f * x * y;
  b.v[5] = -1.0925484305920792f * y * z;
  b.v[6] = 0.31539156525252005f * (2.0f * zz - xx - yy);
  b.v[7] = -1.0925484305920792f * x * z;
  b.v[8] = 0.5462742152960396f * (xx - yy);
  b.v[9] = -0.5900435899266435f * y * (3.0f * xx - yy);
  b.v[10] = 2.890611442640554f * x * y * z;
  b.v[11] = -0.4570457994644658f * y * (4.0f * zz - xx - yy);
  b.v[12] = 0.3731763325901154f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
  b.v[13] = -0.4570457994644658f * x * (4.0f * zz - xx - yy);
  b.v[14] = 1.445305721320277f * z * (xx - yy);
  b.v[15] = -0.5900435899266435f * x * (xx - 3.0f * yy);
  return b;
}

// One colour channel from the harmonic sum: shifted by 1/2, not below 0, not clamped above.
STGS_FN float sh_colour(float sum) {
  return larger(0.0f, sum + 0.5f);
}

STGS_MATH_END

#endif
