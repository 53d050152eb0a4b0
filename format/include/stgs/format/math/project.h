// SPDX-License-Identifier: Apache-2.0
// Projection of a 3D Gaussian to a screen-space splat: covariance, EWA projection, opacity-aware
// extent (spec/representation.md, 3). Camera axes are OpenCV's: x right, y down, z forward. Pixel
// (i,j) covers [i,i+1) x [j,j+1); its centre is at +0.5.
#ifndef STGS_FORMAT_MATH_PROJECT_H
#define STGS_FORMAT_MATH_PROJECT_H

#include "lang.h"

STGS_MATH_BEGIN

// Kernels of the splats (spec/representation.md, 3.4). kDilated is that of 3DGS. With kBandLimited
// (Mip-Splatting), a splat of any size has the integral of its Gaussian over the image.
const int kDilated = 0;
const int kBandLimited = 1;

// Variance that a kernel adds to both axes of a projected Gaussian, pixels^2.
STGS_FN float screen_blur(int kernel) {
  return kernel == kBandLimited ? 0.1f : 0.3f;
}

// The projection is linearised inside the image, enlarged by this share of its size on each side.
const float kFrustumMargin = 0.15f;

// Pinhole camera: p_camera = rotation p_world + translation; lengths in scene units, the rest in
// pixels. Points nearer than near_plane are not rendered.
struct PinholeCamera {
  Mat3 rotation;
  Vec3 translation;
  float fx, fy, cx, cy;
  float width, height;
  float near_plane;
};

// A projected Gaussian; its weight at pixel offset d is exp(-d' conic d / 2).
struct Projection {
  Vec2 mean;
  Sym2 covariance;
  Sym2 conic;
  // In [0, 1): the factor of the peak that keeps the integral as it is without the blur,
  // sqrt(det(covariance - blur I) / det(covariance)).
  float coverage;
  float depth;  // camera z, scene units
  int visible;  // 0: cannot be rendered; the other fields are then unspecified
};

// Rotation matrix of a quaternion of any nonzero length.
STGS_FN Mat3 rotation_of(Quat q) {
  float n = 1.0f / sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  float w = q.w * n;
  float x = q.x * n;
  float y = q.y * n;
  float z = q.z * n;
  Mat3 m;
  m.xx = 1.0f - 2.0f * (y * y + z * z);
  m.xy = 2.0f * (x * y - w * z);
  m.xz = 2.0f * (x * z + w * y);
  m.yx = 2.0f * (x * y + w * z);
  m.yy = 1.0f - 2.0f * (x * x + z * z);
  m.yz = 2.0f * (y * z - w * x);
  m.zx = 2.0f * (x * z - w * y);
  m.zy = 2.0f * (y * z + w * x);
  m.zz = 1.0f - 2.0f * (x * x + y * y);
  return m;
}

// Covariance R diag(s^2) R', where s are the standard deviations along the axes of R.
STGS_FN Sym3 covariance_of(Quat q, Vec3 s) {
  Mat3 r = rotation_of(q);
  float a = s.x * s.x;
  float b = s.y * s.y;
  float c = s.z * s.z;
  Sym3 v;
  v.xx = a * r.xx * r.xx + b * r.xy * r.xy + c * r.xz * r.xz;
  v.xy = a * r.xx * r.yx + b * r.xy * r.yy + c * r.xz * r.yz;
  v.xz = a * r.xx * r.zx + b * r.xy * r.zy + c * r.xz * r.zz;
  v.yy = a * r.yx * r.yx + b * r.yy * r.yy + c * r.yz * r.yz;
  v.yz = a * r.yx * r.zx + b * r.yy * r.zy + c * r.yz * r.zz;
  v.zz = a * r.zx * r.zx + b * r.zy * r.zy + c * r.zz * r.zz;
  return v;
}

// Centre of the camera in world space.
STGS_FN Vec3 camera_centre(PinholeCamera camera) {
  Vec3 c = mat3_transpose_mul(camera.rotation, camera.translation);
  return vec3_of(-c.x, -c.y, -c.z);
}

// World space to camera space.
STGS_FN Vec3 to_camera(PinholeCamera camera, Vec3 p) {
  Vec3 c = mat3_mul(camera.rotation, p);
  return vec3_of(c.x + camera.translation.x, c.y + camera.translation.y,
                 c.z + camera.translation.z);
}

// The two rows of J W: d(pixel)/d(world) at camera point c. x/z and y/z are clamped to the enlarged
// image, so that a Gaussian outside the frustum does not blow up.
struct ProjectionRows {
  Vec3 u, v;
};

STGS_FN ProjectionRows projection_rows(PinholeCamera camera, Vec3 c) {
  float iz = 1.0f / c.z;
  float mx = kFrustumMargin * camera.width;
  float my = kFrustumMargin * camera.height;
  float tx =
      clamped(c.x * iz, (-mx - camera.cx) / camera.fx, (camera.width + mx - camera.cx) / camera.fx);
  float ty = clamped(c.y * iz, (-my - camera.cy) / camera.fy,
                     (camera.height + my - camera.cy) / camera.fy);
  float jx = camera.fx * iz;
  float jy = camera.fy * iz;
  Mat3 w = camera.rotation;
  ProjectionRows r;
  r.u = vec3_of(jx * (w.xx - tx * w.zx), jx * (w.xy - tx * w.zy), jx * (w.xz - tx * w.zz));
  r.v = vec3_of(jy * (w.yx - ty * w.zx), jy * (w.yy - ty * w.zy), jy * (w.yz - ty * w.zz));
  return r;
}

STGS_FN Vec3 sym3_mul(Sym3 s, Vec3 v) {
  return vec3_of(s.xx * v.x + s.xy * v.y + s.xz * v.z, s.xy * v.x + s.yy * v.y + s.yz * v.z,
                 s.xz * v.x + s.yz * v.y + s.zz * v.z);
}

// EWA projection of a Gaussian with the given mean and covariance in world space. `blur`: that of
// the kernel.
STGS_FN Projection project_gaussian(PinholeCamera camera, Vec3 mean, Sym3 covariance, float blur) {
  Projection p;
  p.visible = 0;
  p.mean = vec2_of(0.0f, 0.0f);
  p.covariance.xx = 0.0f;
  p.covariance.xy = 0.0f;
  p.covariance.yy = 0.0f;
  p.conic = p.covariance;
  p.coverage = 0.0f;
  Vec3 c = to_camera(camera, mean);
  p.depth = c.z;
  if (c.z < camera.near_plane) return p;
  ProjectionRows j = projection_rows(camera, c);
  Vec3 su = sym3_mul(covariance, j.u);
  Vec3 sv = sym3_mul(covariance, j.v);
  float xy = dot3(j.u, sv);
  float sharp_xx = dot3(j.u, su);
  float sharp_yy = dot3(j.v, sv);
  float xx = sharp_xx + blur;
  float yy = sharp_yy + blur;
  float determinant = xx * yy - xy * xy;
  if (!(determinant > 0.0f)) return p;
  float inverse = 1.0f / determinant;
  p.coverage = sqrt(larger(0.0f, (sharp_xx * sharp_yy - xy * xy) * inverse));
  p.mean = vec2_of(camera.fx * c.x / c.z + camera.cx, camera.fy * c.y / c.z + camera.cy);
  p.covariance.xx = xx;
  p.covariance.xy = xy;
  p.covariance.yy = yy;
  p.conic.xx = yy * inverse;
  p.conic.xy = -xy * inverse;
  p.conic.yy = xx * inverse;
  p.visible = 1;
  return p;
}

// Opacity O_s of the splat of a Gaussian of opacity O_t.
STGS_FN float splat_opacity(int kernel, float opacity, Projection p) {
  return kernel == kBandLimited ? opacity * p.coverage : opacity;
}

// Half size, in pixels, of the axis-aligned box of {d : opacity exp(-d' conic d / 2) >= threshold};
// negative if the set is empty.
STGS_FN Vec2 splat_extent(Sym2 covariance, float opacity, float threshold) {
  if (opacity < threshold) return vec2_of(-1.0f, -1.0f);
  float q = 2.0f * log(opacity / threshold);
  return vec2_of(sqrt(q * covariance.xx), sqrt(q * covariance.yy));
}

// Elongation of a splat, at least 1. The rounding error of the conic as the inverse of the
// covariance grows with it.
STGS_FN float elongation_of(Projection p) {
  return p.covariance.xx * p.conic.xx;
}

// Factor that makes an extent enclose the ellipse of the rounded conic.
STGS_FN float extent_slack(float elongation) {
  return 1.0f + 1e-6f * (1.0f + elongation);
}

// Whether the box around `mean` lies outside the image. Also true if a value is NaN.
STGS_FN bool outside_image(PinholeCamera camera, Vec2 mean, Vec2 extent) {
  return !(mean.x + extent.x >= 0.0f && mean.y + extent.y >= 0.0f &&
           mean.x - extent.x <= camera.width && mean.y - extent.y <= camera.height);
}

STGS_MATH_END

#endif
