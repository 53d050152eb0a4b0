// SPDX-License-Identifier: Apache-2.0
// The language subset shared by C++, CUDA and GLSL: free functions over float, int and plain
// structs, all by value; no references, overloads or templates. Only the macros below and
// is_finite() differ.
#ifndef STGS_FORMAT_MATH_LANG_H
#define STGS_FORMAT_MATH_LANG_H

#if defined(GL_core_profile)  // GLSL: set by the compiler for desktop core profiles
#define STGS_MATH_BEGIN
#define STGS_MATH_END
#define STGS_FN
#define STGS_ALIGNED(bytes)
#else
#include <cmath>
#define STGS_MATH_BEGIN  \
  namespace stgs::math { \
  using std::abs;        \
  using std::exp;        \
  using std::floor;      \
  using std::log;        \
  using std::log2;       \
  using std::sqrt;
#define STGS_MATH_END }
#define STGS_ALIGNED(bytes) alignas(bytes)
#if defined(__CUDACC__)
#define STGS_FN __host__ __device__ inline
#else
#define STGS_FN inline
#endif
#endif

STGS_MATH_BEGIN

struct Vec2 {
  float x, y;
};
struct Vec3 {
  float x, y, z;
};
// The quaternion w + xi + yj + zk.
struct Quat {
  float w, x, y, z;
};
// 3x3 matrix; members are named row, then column.
struct Mat3 {
  float xx, xy, xz, yx, yy, yz, zx, zy, zz;
};
// Symmetric 2x2 matrix.
struct Sym2 {
  float xx, xy, yy;
};
// Symmetric 3x3 matrix.
struct Sym3 {
  float xx, xy, xz, yy, yz, zz;
};

STGS_FN Vec2 vec2_of(float x, float y) {
  Vec2 v;
  v.x = x;
  v.y = y;
  return v;
}

STGS_FN Vec3 vec3_of(float x, float y, float z) {
  Vec3 v;
  v.x = x;
  v.y = y;
  v.z = z;
  return v;
}

// Whether x is neither infinite nor NaN. GLSL tests the bits, which compilers cannot optimise away.
#if defined(GL_core_profile)
STGS_FN bool is_finite(float x) {
  return (floatBitsToUint(x) & 0x7F800000u) != 0x7F800000u;
}
#else
STGS_FN bool is_finite(float x) {
  return std::isfinite(x);
}
#endif

STGS_FN float larger(float a, float b) {
  return a > b ? a : b;
}
STGS_FN float smaller(float a, float b) {
  return a < b ? a : b;
}
STGS_FN float clamped(float x, float low, float high) {
  return smaller(larger(x, low), high);
}

STGS_FN float dot3(Vec3 a, Vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

STGS_FN Mat3 mat3_of_columns(Vec3 x, Vec3 y, Vec3 z) {
  Mat3 m;
  m.xx = x.x;
  m.yx = x.y;
  m.zx = x.z;
  m.xy = y.x;
  m.yy = y.y;
  m.zy = y.z;
  m.xz = z.x;
  m.yz = z.y;
  m.zz = z.z;
  return m;
}

STGS_FN Vec3 mat3_mul(Mat3 m, Vec3 v) {
  return vec3_of(m.xx * v.x + m.xy * v.y + m.xz * v.z, m.yx * v.x + m.yy * v.y + m.yz * v.z,
                 m.zx * v.x + m.zy * v.y + m.zz * v.z);
}

STGS_FN Vec3 mat3_transpose_mul(Mat3 m, Vec3 v) {
  return vec3_of(m.xx * v.x + m.yx * v.y + m.zx * v.z, m.xy * v.x + m.yy * v.y + m.zy * v.z,
                 m.xz * v.x + m.yz * v.y + m.zz * v.z);
}

STGS_MATH_END

#endif
