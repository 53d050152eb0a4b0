// SPDX-License-Identifier: Apache-2.0
// The surface represented by flat primitives, for the normal-depth consistency loss of training
// (paper 3.4, L_n; PGSR, arXiv 2406.06521). A primitive is the plane through its centre that is
// orthogonal to its shortest axis. Planes are blended like colours, and the depth of a pixel is
// where its ray meets the blended plane. This depth is exact for a single slanted primitive;
// blending the depths of centres would give a step without slope, so that N_depth could never equal
// the primitive's normal. Everything is in camera space: OpenCV axes, scene units.
#ifndef STGS_FORMAT_MATH_SURFACE_H
#define STGS_FORMAT_MATH_SURFACE_H

#include "project.h"

STGS_MATH_BEGIN

// A pixel with a lower alpha shows no surface.
const float kSurfaceAlpha = 0.5f;
// Nor does a pixel whose blended normal is nearly orthogonal to the ray, or whose contributions
// cancel: lower bound of -(ray . normal) / alpha that keeps depth and gradients bounded.
const float kSurfaceFacing = 0.05f;

// The plane {p : dot3(normal, p) = distance}. A primitive's normal has length 1 and points towards
// the camera, so its distance is <= 0. A blend of planes is their weighted sum.
struct Plane {
  Vec3 normal;
  float distance;  // scene units
};

STGS_FN Vec3 cross3(Vec3 a, Vec3 b) {
  return vec3_of(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Index of the shortest axis; the first one of equals. Works on logarithms too.
STGS_FN int shortest_axis(Vec3 scale) {
  if (scale.x <= scale.y && scale.x <= scale.z) return 0;
  return scale.y <= scale.z ? 1 : 2;
}

STGS_FN Vec3 mat3_column(Mat3 m, int k) {
  if (k == 0) return vec3_of(m.xx, m.yx, m.zx);
  if (k == 1) return vec3_of(m.xy, m.yy, m.zy);
  return vec3_of(m.xz, m.yz, m.zz);
}

// Plane of a primitive at a world position, with rotation q and standard deviations `scale`.
STGS_FN Plane primitive_plane(PinholeCamera camera, Vec3 position, Quat q, Vec3 scale) {
  Vec3 n = mat3_mul(camera.rotation, mat3_column(rotation_of(q), shortest_axis(scale)));
  float along = dot3(n, to_camera(camera, position));
  float facing = along > 0.0f ? -1.0f : 1.0f;
  Plane p;
  p.normal = vec3_of(facing * n.x, facing * n.y, facing * n.z);
  p.distance = facing * along;
  return p;
}

// Ray through the pixel position (x, y): its point at camera z = 1.
STGS_FN Vec3 pixel_ray(PinholeCamera camera, float x, float y) {
  return vec3_of((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0f);
}

// Camera z where the ray meets the blended plane; 0 if the pixel shows no surface.
STGS_FN float plane_depth(Plane blend, float alpha, Vec3 ray) {
  float facing = -dot3(blend.normal, ray);
  if (!(alpha >= kSurfaceAlpha && facing >= kSurfaceFacing * alpha)) return 0.0f;
  return larger(0.0f, -blend.distance / facing);
}

// Normal, towards the camera, of a surface with the differences `down` (below minus above) and
// `right` (right minus left) between neighbouring pixels. Its length is 0 if they are parallel.
STGS_FN Vec3 surface_normal(Vec3 down, Vec3 right) {
  Vec3 c = cross3(down, right);
  float square = dot3(c, c);
  float inverse = square > 1e-30f ? 1.0f / sqrt(square) : 0.0f;
  return vec3_of(c.x * inverse, c.y * inverse, c.z * inverse);
}

// Weight of a pixel in L_n, from its image gradient relative to the greatest one of the image:
// lower at edges, where depth may jump.
STGS_FN float flatness_weight(float gradient) {
  float rest = clamped(1.0f - gradient, 0.0f, 1.0f);
  return rest * rest;
}

STGS_MATH_END

#endif
