// SPDX-License-Identifier: Apache-2.0
// Vectors of the cameras of viewers and videos, in double precision.
#pragma once

#include <cmath>

namespace stgs::tools {

struct Vector3 {
  double x = 0, y = 0, z = 0;
};

inline Vector3 operator+(const Vector3& a, const Vector3& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}

inline Vector3 operator-(const Vector3& a, const Vector3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

inline Vector3 operator*(double factor, const Vector3& v) {
  return {factor * v.x, factor * v.y, factor * v.z};
}

inline double dot(const Vector3& a, const Vector3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline double length(const Vector3& v) {
  return std::sqrt(dot(v, v));
}

inline Vector3 unit(const Vector3& v) {
  return (1 / length(v)) * v;
}

// Rotates v about a unit axis by `angle` radians (Rodrigues' formula).
inline Vector3 rotated(const Vector3& v, const Vector3& axis, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return c * v + s * cross(axis, v) + ((1 - c) * dot(axis, v)) * axis;
}

}  // namespace stgs::tools
