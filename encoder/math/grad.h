// SPDX-License-Identifier: Apache-2.0
// Backward passes of format/math, in the same subset of C++, CUDA and GLSL. Each function takes the
// inputs of its forward pass and the loss gradient with respect to the forward output, and returns
// the gradient with respect to the inputs. Gradients of symmetric matrices are with respect to
// their named entries (an off-diagonal entry stands for both positions), so they apply without
// factors.
#ifndef STGS_ENCODER_MATH_GRAD_H
#define STGS_ENCODER_MATH_GRAD_H

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/math/surface.h"

STGS_MATH_BEGIN

STGS_FN Vec3 vec3_add(Vec3 a, Vec3 b) {
  return vec3_of(a.x + b.x, a.y + b.y, a.z + b.z);
}
STGS_FN Vec3 vec3_scale(Vec3 a, float s) {
  return vec3_of(a.x * s, a.y * s, a.z * s);
}

// --- Time (paper eq. 1 and 2) --------------------------------------------------------------------

struct VisibilityGrad {
  float dt, sigma, radius;
};

// Backward of l(t): 0 on the flat top, where l is constant.
STGS_FN VisibilityGrad visibility_grad(float dt, float sigma, float radius, float grad) {
  VisibilityGrad g;
  g.dt = 0.0f;
  g.sigma = 0.0f;
  g.radius = 0.0f;
  float beyond = abs(dt) - radius;
  if (beyond <= 0.0f) return g;
  float x = beyond / sigma;
  float by_beyond = -2.0f * x / sigma * exp(-x * x) * grad;
  g.dt = dt < 0.0f ? -by_beyond : by_beyond;
  g.sigma = -x * by_beyond;
  g.radius = -by_beyond;
  return g;
}

// Converts the gradient of u = v / f to that of the learnt v, with the lifespan held constant.
STGS_FN Vec3 effective_velocity_grad(float sigma, float radius, Vec3 grad_u) {
  return vec3_scale(grad_u, 1.0f / lifespan_modulation(sigma, radius));
}

struct MotionGrad {
  Vec3 position, u;
  float dt;
};

STGS_FN MotionGrad position_at_grad(Vec3 u, float dt, Vec3 grad) {
  MotionGrad g;
  g.position = grad;
  g.u = vec3_scale(grad, dt);
  g.dt = dot3(grad, u);
  return g;
}

// --- Covariance ----------------------------------------------------------------------------------

// Backward of rotation_of, through the normalisation of q.
STGS_FN Quat rotation_grad(Quat q, Mat3 d) {
  float n = 1.0f / sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  float w = q.w * n;
  float x = q.x * n;
  float y = q.y * n;
  float z = q.z * n;
  float gw = 2.0f * (x * (d.zy - d.yz) + y * (d.xz - d.zx) + z * (d.yx - d.xy));
  float gx =
      2.0f * (w * (d.zy - d.yz) + y * (d.xy + d.yx) + z * (d.xz + d.zx)) - 4.0f * x * (d.yy + d.zz);
  float gy =
      2.0f * (w * (d.xz - d.zx) + x * (d.xy + d.yx) + z * (d.yz + d.zy)) - 4.0f * y * (d.xx + d.zz);
  float gz =
      2.0f * (w * (d.yx - d.xy) + x * (d.xz + d.zx) + y * (d.yz + d.zy)) - 4.0f * z * (d.xx + d.yy);
  float along = gw * w + gx * x + gy * y + gz * z;
  Quat g;
  g.w = n * (gw - along * w);
  g.x = n * (gx - along * x);
  g.y = n * (gy - along * y);
  g.z = n * (gz - along * z);
  return g;
}

struct CovarianceGrad {
  Quat rotation;
  Vec3 scale;  // of the standard deviations; multiply by them for their logarithms
};

STGS_FN CovarianceGrad covariance_grad(Quat q, Vec3 s, Sym3 d) {
  Mat3 r = rotation_of(q);
  // With the full symmetric G: dR = 2 G R diag(s^2), ds_k = 2 s_k (R' G R)_kk.
  Sym3 g2;
  g2.xx = 2.0f * d.xx;
  g2.xy = d.xy;
  g2.xz = d.xz;
  g2.yy = 2.0f * d.yy;
  g2.yz = d.yz;
  g2.zz = 2.0f * d.zz;
  Vec3 cx = vec3_of(r.xx, r.yx, r.zx);
  Vec3 cy = vec3_of(r.xy, r.yy, r.zy);
  Vec3 cz = vec3_of(r.xz, r.yz, r.zz);
  Vec3 gx = sym3_mul(g2, cx);
  Vec3 gy = sym3_mul(g2, cy);
  Vec3 gz = sym3_mul(g2, cz);
  CovarianceGrad g;
  g.scale = vec3_of(s.x * dot3(cx, gx), s.y * dot3(cy, gy), s.z * dot3(cz, gz));
  Mat3 dr = mat3_of_columns(vec3_scale(gx, s.x * s.x), vec3_scale(gy, s.y * s.y),
                            vec3_scale(gz, s.z * s.z));
  g.rotation = rotation_grad(q, dr);
  return g;
}

// --- Projection ----------------------------------------------------------------------------------

// Backward of the inverse of a symmetric 2x2 matrix, from the inverse itself.
STGS_FN Sym2 inverse_grad(Sym2 inverse, Sym2 d) {
  float a = inverse.xx;
  float b = inverse.xy;
  float c = inverse.yy;
  float h = 0.5f * d.xy;
  Sym2 g;
  g.xx = -(a * a * d.xx + 2.0f * a * b * h + b * b * d.yy);
  g.xy = -2.0f * (a * b * d.xx + (a * c + b * b) * h + b * c * d.yy);
  g.yy = -(b * b * d.xx + 2.0f * b * c * h + c * c * d.yy);
  return g;
}

// Backward of projection_rows to the camera point; 0 through x/z or y/z if the forward clamps it.
STGS_FN Vec3 projection_rows_grad(PinholeCamera camera, Vec3 c, Vec3 du, Vec3 dv) {
  float iz = 1.0f / c.z;
  float x = c.x * iz;
  float y = c.y * iz;
  float mx = kFrustumMargin * camera.width;
  float my = kFrustumMargin * camera.height;
  float tx = clamped(x, (-mx - camera.cx) / camera.fx, (camera.width + mx - camera.cx) / camera.fx);
  float ty =
      clamped(y, (-my - camera.cy) / camera.fy, (camera.height + my - camera.cy) / camera.fy);
  Mat3 w = camera.rotation;
  Vec3 wz = vec3_of(w.zx, w.zy, w.zz);
  Vec3 u = vec3_of(w.xx - tx * w.zx, w.xy - tx * w.zy, w.xz - tx * w.zz);
  Vec3 v = vec3_of(w.yx - ty * w.zx, w.yy - ty * w.zy, w.yz - ty * w.zz);
  float by_x = tx == x ? -camera.fx * iz * dot3(du, wz) : 0.0f;
  float by_y = ty == y ? -camera.fy * iz * dot3(dv, wz) : 0.0f;
  float by_iz = camera.fx * dot3(du, u) + camera.fy * dot3(dv, v) + by_x * c.x + by_y * c.y;
  return vec3_of(by_x * iz, by_y * iz, -by_iz * iz * iz);
}

struct ProjectionGrad {
  Vec3 position;    // of the world mean
  Sym3 covariance;  // of the world covariance
};

// Gradients of the results of project_gaussian.
struct SplatShapeGrad {
  Vec2 mean;
  Sym2 conic;
  float log_coverage;  // of ln(coverage)
  float coverage;      // the value of the forward pass; > 0 if it has a gradient
};

// Backward of the conic and the coverage to the screen covariance. `sharp`: the same without the
// blur. Its determinant follows from the coverage: as a difference of products it could be 0.
STGS_FN Sym2 screen_covariance_grad(Sym2 sharp, Sym2 conic, SplatShapeGrad grad) {
  Sym2 d = inverse_grad(conic, grad.conic);
  if (grad.log_coverage == 0.0f) return d;
  float half_inverse =
      0.5f * (conic.xx * conic.yy - conic.xy * conic.xy) / (grad.coverage * grad.coverage);
  d.xx += grad.log_coverage * (sharp.yy * half_inverse - 0.5f * conic.xx);
  d.xy -= grad.log_coverage * (2.0f * sharp.xy * half_inverse + conic.xy);
  d.yy += grad.log_coverage * (sharp.xx * half_inverse - 0.5f * conic.yy);
  return d;
}

// Backward of project_gaussian for a Gaussian that it reported visible.
STGS_FN ProjectionGrad project_gaussian_grad(PinholeCamera camera, Vec3 mean, Sym3 covariance,
                                             Sym2 conic, SplatShapeGrad grad) {
  Vec3 c = to_camera(camera, mean);
  ProjectionRows j = projection_rows(camera, c);
  Vec3 su = sym3_mul(covariance, j.u);
  Vec3 sv = sym3_mul(covariance, j.v);
  Sym2 sharp;
  sharp.xx = dot3(j.u, su);
  sharp.xy = dot3(j.u, sv);
  sharp.yy = dot3(j.v, sv);
  Sym2 d = screen_covariance_grad(sharp, conic, grad);
  Vec3 du = vec3_add(vec3_scale(su, 2.0f * d.xx), vec3_scale(sv, d.xy));
  Vec3 dv = vec3_add(vec3_scale(sv, 2.0f * d.yy), vec3_scale(su, d.xy));
  Vec3 by_c = projection_rows_grad(camera, c, du, dv);
  float iz = 1.0f / c.z;
  float mx = grad.mean.x * camera.fx * iz;
  float my = grad.mean.y * camera.fy * iz;
  by_c = vec3_add(by_c, vec3_of(mx, my, -(mx * c.x + my * c.y) * iz));
  ProjectionGrad g;
  g.position = mat3_transpose_mul(camera.rotation, by_c);
  g.covariance.xx = d.xx * j.u.x * j.u.x + d.xy * j.u.x * j.v.x + d.yy * j.v.x * j.v.x;
  g.covariance.yy = d.xx * j.u.y * j.u.y + d.xy * j.u.y * j.v.y + d.yy * j.v.y * j.v.y;
  g.covariance.zz = d.xx * j.u.z * j.u.z + d.xy * j.u.z * j.v.z + d.yy * j.v.z * j.v.z;
  g.covariance.xy = 2.0f * d.xx * j.u.x * j.u.y + d.xy * (j.u.x * j.v.y + j.u.y * j.v.x) +
                    2.0f * d.yy * j.v.x * j.v.y;
  g.covariance.xz = 2.0f * d.xx * j.u.x * j.u.z + d.xy * (j.u.x * j.v.z + j.u.z * j.v.x) +
                    2.0f * d.yy * j.v.x * j.v.z;
  g.covariance.yz = 2.0f * d.xx * j.u.y * j.u.z + d.xy * (j.u.y * j.v.z + j.u.z * j.v.y) +
                    2.0f * d.yy * j.v.y * j.v.z;
  return g;
}

// --- Colour --------------------------------------------------------------------------------------

// Gradient of sum_k g.v[k] basis.v[k] with respect to the direction d, its entries independent.
STGS_FN Vec3 sh_basis_grad(Vec3 d, ShBasis g) {
  float x = d.x;
  float y = d.y;
  float z = d.z;
  float xx = x * x;
  float yy = y * y;
  float zz = z * z;
  float r31 = 4.0f * zz - xx - yy;
  Vec3 s;
  s.x = -kSh1 * g.v[3] + kSh21 * (y * g.v[4] - z * g.v[7] + x * g.v[8]) -
        2.0f * kSh20 * x * g.v[6] - 6.0f * kSh33 * x * y * g.v[9] +
        kSh32 * (y * z * g.v[10] + x * z * g.v[14]) +
        kSh31 * (2.0f * x * y * g.v[11] + (2.0f * xx - r31) * g.v[13]) -
        6.0f * kSh30 * x * z * g.v[12] - 3.0f * kSh33 * (xx - yy) * g.v[15];
  s.y = -kSh1 * g.v[1] + kSh21 * (x * g.v[4] - z * g.v[5] - y * g.v[8]) -
        2.0f * kSh20 * y * g.v[6] - 3.0f * kSh33 * (xx - yy) * g.v[9] +
        kSh32 * (x * z * g.v[10] - y * z * g.v[14]) +
        kSh31 * ((2.0f * yy - r31) * g.v[11] + 2.0f * x * y * g.v[13]) -
        6.0f * kSh30 * y * z * g.v[12] + 6.0f * kSh33 * x * y * g.v[15];
  s.z = kSh1 * g.v[2] - kSh21 * (y * g.v[5] + x * g.v[7]) + 4.0f * kSh20 * z * g.v[6] +
        kSh32 * (x * y * g.v[10] + 0.5f * (xx - yy) * g.v[14]) -
        8.0f * kSh31 * z * (y * g.v[11] + x * g.v[13]) +
        3.0f * kSh30 * (2.0f * zz - xx - yy) * g.v[12];
  return s;
}

// Backward of v / |v|, from n = v / |v| and 1 / |v|.
STGS_FN Vec3 normalise_grad(Vec3 n, float inverse_length, Vec3 grad) {
  float along = dot3(n, grad);
  return vec3_of((grad.x - along * n.x) * inverse_length, (grad.y - along * n.y) * inverse_length,
                 (grad.z - along * n.z) * inverse_length);
}

// --- Surface -------------------------------------------------------------------------------------

struct PrimitivePlaneGrad {
  Vec3 position;  // world space
  Quat rotation;
};

// Backward of primitive_plane, with its choices of axis and side held constant.
STGS_FN PrimitivePlaneGrad primitive_plane_grad(PinholeCamera camera, Vec3 position, Quat q,
                                                Vec3 scale, Plane d) {
  int axis = shortest_axis(scale);
  Vec3 n = mat3_mul(camera.rotation, mat3_column(rotation_of(q), axis));
  Vec3 c = to_camera(camera, position);
  float facing = dot3(n, c) > 0.0f ? -1.0f : 1.0f;
  Vec3 by_n = vec3_scale(vec3_add(d.normal, vec3_scale(c, d.distance)), facing);
  PrimitivePlaneGrad g;
  g.position = mat3_transpose_mul(camera.rotation, vec3_scale(n, facing * d.distance));
  Vec3 column = mat3_transpose_mul(camera.rotation, by_n);
  Mat3 dr = mat3_of_columns(vec3_scale(column, axis == 0 ? 1.0f : 0.0f),
                            vec3_scale(column, axis == 1 ? 1.0f : 0.0f),
                            vec3_scale(column, axis == 2 ? 1.0f : 0.0f));
  g.rotation = rotation_grad(q, dr);
  return g;
}

// Backward of plane_depth to the blended plane, from the depth itself; 0 if there is no surface.
STGS_FN Plane plane_depth_grad(Plane blend, float depth, Vec3 ray, float grad) {
  Plane g;
  g.normal = vec3_of(0.0f, 0.0f, 0.0f);
  g.distance = 0.0f;
  if (!(depth > 0.0f)) return g;
  g.distance = grad / dot3(blend.normal, ray);
  g.normal = vec3_scale(ray, -depth * g.distance);
  return g;
}

struct SurfaceNormalGrad {
  Vec3 down, right;
};

STGS_FN SurfaceNormalGrad surface_normal_grad(Vec3 down, Vec3 right, Vec3 grad) {
  Vec3 c = cross3(down, right);
  float square = dot3(c, c);
  float inverse = square > 1e-30f ? 1.0f / sqrt(square) : 0.0f;
  Vec3 by_c = normalise_grad(vec3_scale(c, inverse), inverse, grad);
  SurfaceNormalGrad g;
  g.down = cross3(right, by_c);
  g.right = cross3(by_c, down);
  return g;
}

// A pixel's term of L_n, weight |alpha N_depth - N_render|_1 with alpha held constant (PGSR), and
// its gradients with respect to the blended normal and the two point differences that define
// N_depth. All are 0 if the differences are collinear.
struct NormalTerm {
  float value;
  Vec3 normal, down, right;
};

STGS_FN NormalTerm normal_term(Vec3 blended_normal, float alpha, Vec3 down, Vec3 right,
                               float weight) {
  Vec3 n = surface_normal(down, right);
  float w = dot3(n, n) > 0.0f ? weight : 0.0f;
  Vec3 d = vec3_add(vec3_scale(n, alpha), vec3_scale(blended_normal, -1.0f));
  Vec3 slope = vec3_of(d.x > 0.0f ? w : -w, d.y > 0.0f ? w : -w, d.z > 0.0f ? w : -w);
  SurfaceNormalGrad by_points = surface_normal_grad(down, right, vec3_scale(slope, alpha));
  NormalTerm t;
  t.value = dot3(slope, d);
  t.normal = vec3_scale(slope, -1.0f);
  t.down = by_points.down;
  t.right = by_points.right;
  return t;
}

// --- Alpha ---------------------------------------------------------------------------------------

// d opacity_of / d logit, from the opacity itself.
STGS_FN float opacity_grad(float opacity) {
  return opacity * (1.0f - opacity);
}

struct AlphaGrad {
  float opacity, power;
};

// Backward of splat_alpha of a rendered splat; 0 if alpha is clamped at kAlphaMax.
STGS_FN AlphaGrad splat_alpha_grad(float opacity, float power, float grad) {
  float falloff = exp(-larger(0.0f, power));
  AlphaGrad g;
  g.opacity = 0.0f;
  g.power = 0.0f;
  if (opacity * falloff > kAlphaMax) return g;
  g.opacity = falloff * grad;
  g.power = -opacity * falloff * grad;
  return g;
}

struct PowerGrad {
  Vec2 offset;
  Sym2 conic;
};

// Backward of splat_power to the pixel's offset from the mean (negate for the mean) and the conic.
STGS_FN PowerGrad splat_power_grad(Sym2 conic, float dx, float dy, float grad) {
  PowerGrad g;
  g.offset =
      vec2_of((conic.xx * dx + conic.xy * dy) * grad, (conic.xy * dx + conic.yy * dy) * grad);
  g.conic.xx = 0.5f * dx * dx * grad;
  g.conic.xy = dx * dy * grad;
  g.conic.yy = 0.5f * dy * dy * grad;
  return g;
}

STGS_MATH_END

#endif
