// SPDX-License-Identifier: Apache-2.0
// The surface that flat primitives stand for, as the normal-depth consistency of training sees it
// (paper 3.4, L_n; PGSR, arXiv 2406.06521): a primitive is the plane through its centre across its
// shortest axis; a picture's planes are the primitives' planes, blended as their colours are; a
// pixel's depth is where its ray meets the blended plane. That depth is exact for a single slanted
// primitive, of which a blend of centres' depths would make a step without a slope: N_depth could
// then never be the primitive's own normal. All is in camera space: OpenCV axes, scene units.
#ifndef STGS_FORMAT_MATH_SURFACE_H
#define STGS_FORMAT_MATH_SURFACE_H

#include "project.h"

STGS_MATH_BEGIN

// Where a pixel is less opaque than this it shows no surface.
const float kSurfaceAlpha = 0.5f;
// Nor where the blended normal is nearly across the ray, or its parts cancel: least
// -(ray . normal) / alpha, where the plane's depth and its gradients are still tame.
const float kSurfaceFacing = 0.05f;

// {p : dot3(normal, p) = distance}. A primitive's normal has length 1 and points towards the
// camera, so its distance is <= 0; a blend of planes is their weighted sum.
struct Plane {
  Vec3 normal;
  float distance;  // scene units
};

STGS_FN Vec3 cross3(Vec3 a, Vec3 b) {
  return vec3_of(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

// Index of the shortest axis, of equal ones the first. Logarithms do as well.
STGS_FN int shortest_axis(Vec3 scale) {
  if (scale.x <= scale.y && scale.x <= scale.z) return 0;
  return scale.y <= scale.z ? 1 : 2;
}

STGS_FN Vec3 mat3_column(Mat3 m, int k) {
  if (k == 0) return vec3_of(m.xx, m.yx, m.zx);
  if (k == 1) return vec3_of(m.xy, m.yy, m.zy);
  return vec3_of(m.xz, m.yz, m.zz);
}

// The plane of a primitive at a world position, with rotation q and standard deviations `scale`.
STGS_FN Plane primitive_plane(PinholeCamera camera, Vec3 position, Quat q, Vec3 scale) {
  Vec3 n = mat3_mul(camera.rotation, mat3_column(rotation_of(q), shortest_axis(scale)));
  float along = dot3(n, to_camera(camera, position));
  float facing = along > 0.0f ? -1.0f : 1.0f;
  Plane p;
  p.normal = vec3_of(facing * n.x, facing * n.y, facing * n.z);
  p.distance = facing * along;
  return p;
}

// The ray of the pixel position (x, y): its point at camera z = 1.
STGS_FN Vec3 pixel_ray(PinholeCamera camera, float x, float y) {
  return vec3_of((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0f);
}

// Camera z where the ray meets the blended plane; 0, which no surface has, where there is none.
STGS_FN float plane_depth(Plane blend, float alpha, Vec3 ray) {
  float facing = -dot3(blend.normal, ray);
  if (!(alpha >= kSurfaceAlpha && facing >= kSurfaceFacing * alpha)) return 0.0f;
  return larger(0.0f, -blend.distance / facing);
}

// Normal, towards the camera, of a surface whose points at the next pixels are `down` (below minus
// above) and `right` (right minus left) apart. Its length is 0 where they are along one line.
STGS_FN Vec3 surface_normal(Vec3 down, Vec3 right) {
  Vec3 c = cross3(down, right);
  float square = dot3(c, c);
  float inverse = square > 1e-30f ? 1.0f / sqrt(square) : 0.0f;
  return vec3_of(c.x * inverse, c.y * inverse, c.z * inverse);
}

// What a pixel's disagreement counts in L_n, from its gradient as a share of the picture's largest:
// less where the picture has an edge, since depth may jump there.
STGS_FN float flatness_weight(float gradient) {
  float rest = clamped(1.0f - gradient, 0.0f, 1.0f);
  return rest * rest;
}

STGS_MATH_END

#endif
