// SPDX-License-Identifier: Apache-2.0
// The coupled 4D Gaussian of 4DGS (Yang et al., ICLR 2024), which an ablation trains in place of
// the paper's representation, in the same subset of C++, CUDA and GLSL as format/math.
//
// A primitive is a Gaussian over (time, x, y, z) with covariance (R S)(R S)'. S holds its standard
// deviations, and R is the rotation x -> left x right of two unit quaternions, whose real part is
// time. Conditioned on a time it is a 3D Gaussian that moves with constant velocity and fades as a
// Gaussian in time: exactly a primitive of format/math with r = 0. R mixes time and space, so the
// unit of time is a free choice.
#ifndef STGS_ENCODER_MATH_COUPLED_H
#define STGS_ENCODER_MATH_COUPLED_H

#include "grad.h"

STGS_MATH_BEGIN

STGS_FN Quat quat_of(float w, float x, float y, float z) {
  Quat q;
  q.w = w;
  q.x = x;
  q.y = y;
  q.z = z;
  return q;
}

STGS_FN Quat quat_mul(Quat a, Quat b) {
  return quat_of(
      a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
      a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w);
}

STGS_FN Quat quat_conjugate(Quat q) {
  return quat_of(q.w, -q.x, -q.y, -q.z);
}

STGS_FN float quat_dot(Quat a, Quat b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}

STGS_FN Quat quat_scale(Quat q, float s) {
  return quat_of(q.w * s, q.x * s, q.y * s, q.z * s);
}

STGS_FN Quat quat_add(Quat a, Quat b) {
  return quat_of(a.w + b.w, a.x + b.x, a.y + b.y, a.z + b.z);
}

STGS_FN Quat quat_normalised(Quat q) {
  return quat_scale(q, 1.0f / sqrt(quat_dot(q, q)));
}

// Backward of n = q / |q|, from the gradient of n.
STGS_FN Quat quat_normalised_grad(Quat q, Quat grad) {
  Quat n = quat_normalised(q);
  Quat across = quat_add(grad, quat_scale(n, -quat_dot(n, grad)));
  return quat_scale(across, 1.0f / sqrt(quat_dot(q, q)));
}

// Parameters: quaternions of any length but 0, and standard deviations along the unrotated axes.
struct Coupled {
  Quat left, right;
  float time;  // units of time
  Vec3 scale;  // scene units
};

// Columns of R S: the mapped time axis and space axes, as vectors (time, x, y, z).
struct CoupledAxes {
  Quat t, x, y, z;
};

STGS_FN CoupledAxes coupled_axes(Coupled g) {
  Quat l = quat_normalised(g.left);
  Quat r = quat_normalised(g.right);
  CoupledAxes a;
  a.t = quat_scale(quat_mul(l, r), g.time);
  a.x = quat_scale(quat_mul(l, quat_mul(quat_of(0.0f, 1.0f, 0.0f, 0.0f), r)), g.scale.x);
  a.y = quat_scale(quat_mul(l, quat_mul(quat_of(0.0f, 0.0f, 1.0f, 0.0f), r)), g.scale.y);
  a.z = quat_scale(quat_mul(l, quat_mul(quat_of(0.0f, 0.0f, 0.0f, 1.0f), r)), g.scale.z);
  return a;
}

// Rows of R S: entry k of row j is coordinate j of axis k.
struct CoupledRows {
  Quat t, x, y, z;
};

STGS_FN CoupledRows coupled_rows(CoupledAxes a) {
  CoupledRows r;
  r.t = quat_of(a.t.w, a.x.w, a.y.w, a.z.w);
  r.x = quat_of(a.t.x, a.x.x, a.y.x, a.z.x);
  r.y = quat_of(a.t.y, a.x.y, a.y.y, a.z.y);
  r.z = quat_of(a.t.z, a.x.z, a.y.z, a.z.z);
  return r;
}

// The 3D Gaussian at a given time. It has constant covariance, moves with u and fades with sigma.
// With the rows of coupled_rows and variance = row_t . row_t:
//   u = row . row_t / variance, sigma = sqrt(2 variance),
//   covariance: dot products of the residual rows, row - u row_t.
struct Conditional {
  Vec3 u;           // scene units per unit of time
  float sigma;      // of l(t) = exp(-(dt / sigma)^2), units of time
  Sym3 covariance;  // scene units^2
};

// Backward of Conditional to the parameters. Gradients of the standard deviations are linear;
// multiply by the deviations for their logarithms.
STGS_FN Coupled coupled_conditional_grad(Coupled g, Conditional d) {
  CoupledAxes axes = coupled_axes(g);
  CoupledRows r = coupled_rows(axes);
  float variance = quat_dot(r.t, r.t);
  float inverse = 1.0f / variance;
  Vec3 u = vec3_of(quat_dot(r.x, r.t) * inverse, quat_dot(r.y, r.t) * inverse,
                   quat_dot(r.z, r.t) * inverse);
  Quat x = quat_add(r.x, quat_scale(r.t, -u.x));
  Quat y = quat_add(r.y, quat_scale(r.t, -u.y));
  Quat z = quat_add(r.z, quat_scale(r.t, -u.z));
  // Of the residual rows. They are orthogonal to the row of time, so nothing passes through u.
  Quat dx = quat_add(quat_scale(x, 2.0f * d.covariance.xx),
                     quat_add(quat_scale(y, d.covariance.xy), quat_scale(z, d.covariance.xz)));
  Quat dy = quat_add(quat_scale(y, 2.0f * d.covariance.yy),
                     quat_add(quat_scale(x, d.covariance.xy), quat_scale(z, d.covariance.yz)));
  Quat dz = quat_add(quat_scale(z, 2.0f * d.covariance.zz),
                     quat_add(quat_scale(x, d.covariance.xz), quat_scale(y, d.covariance.yz)));
  Quat dt = quat_scale(
      quat_add(quat_scale(dx, u.x), quat_add(quat_scale(dy, u.y), quat_scale(dz, u.z))), -1.0f);
  // Through u = row . row_t / variance; row - 2 u row_t is x - u row_t.
  dt = quat_add(dt, quat_scale(quat_add(x, quat_scale(r.t, -u.x)), d.u.x * inverse));
  dt = quat_add(dt, quat_scale(quat_add(y, quat_scale(r.t, -u.y)), d.u.y * inverse));
  dt = quat_add(dt, quat_scale(quat_add(z, quat_scale(r.t, -u.z)), d.u.z * inverse));
  dx = quat_add(dx, quat_scale(r.t, d.u.x * inverse));
  dy = quat_add(dy, quat_scale(r.t, d.u.y * inverse));
  dz = quat_add(dz, quat_scale(r.t, d.u.z * inverse));
  // Through sigma = sqrt(2 variance).
  dt = quat_add(dt, quat_scale(r.t, 2.0f * d.sigma / sqrt(2.0f * variance)));

  // Of the axes, then of their scales and rotations.
  Quat at = quat_of(dt.w, dx.w, dy.w, dz.w);
  Quat ax = quat_of(dt.x, dx.x, dy.x, dz.x);
  Quat ay = quat_of(dt.y, dx.y, dy.y, dz.y);
  Quat az = quat_of(dt.z, dx.z, dy.z, dz.z);
  Coupled out;
  out.time = quat_dot(at, axes.t) / g.time;
  out.scale = vec3_of(quat_dot(ax, axes.x) / g.scale.x, quat_dot(ay, axes.y) / g.scale.y,
                      quat_dot(az, axes.z) / g.scale.z);
  at = quat_scale(at, g.time);
  ax = quat_scale(ax, g.scale.x);
  ay = quat_scale(ay, g.scale.y);
  az = quat_scale(az, g.scale.z);
  // Axis k is l e_k r, with gradient a_k. Gradient of l: a_k (e_k r)*; of e_k r: l* a_k; of r:
  // e_k* l* a_k.
  Quat l = quat_normalised(g.left);
  Quat r1 = quat_normalised(g.right);
  Quat ei = quat_of(0.0f, 1.0f, 0.0f, 0.0f);
  Quat ej = quat_of(0.0f, 0.0f, 1.0f, 0.0f);
  Quat ek = quat_of(0.0f, 0.0f, 0.0f, 1.0f);
  Quat by_l = quat_add(
      quat_add(quat_mul(at, quat_conjugate(r1)), quat_mul(ax, quat_conjugate(quat_mul(ei, r1)))),
      quat_add(quat_mul(ay, quat_conjugate(quat_mul(ej, r1))),
               quat_mul(az, quat_conjugate(quat_mul(ek, r1)))));
  Quat lc = quat_conjugate(l);
  Quat by_r = quat_add(quat_add(quat_mul(lc, at), quat_mul(quat_conjugate(ei), quat_mul(lc, ax))),
                       quat_add(quat_mul(quat_conjugate(ej), quat_mul(lc, ay)),
                                quat_mul(quat_conjugate(ek), quat_mul(lc, az))));
  out.left = quat_normalised_grad(g.left, by_l);
  out.right = quat_normalised_grad(g.right, by_r);
  return out;
}

// --- As rendered ---------------------------------------------------------------------------------

// The equivalent primitive of format/math: r = 0, times in ticks.
struct CoupledPrimitive {
  Vec3 log_scale;  // log scene units
  Quat rotation;
  Vec3 u;       // scene units per tick
  float sigma;  // ticks
};

// Rows of a matrix, and the accumulated rotation of space.
struct RotatedRows {
  Quat x, y, z;
  Quat rotation;
};

// Makes the first two rows orthogonal with the smallest rotation that does so, then relabels the
// rows x, y, z as y, z, x: three calls make every pair orthogonal once.
STGS_FN RotatedRows rotate_rows(RotatedRows r) {
  float product = quat_dot(r.x, r.y);
  float tangent = 0.0f;
  if (product != 0.0f) {
    // Of twice the rotation angle.
    float cotangent = (quat_dot(r.x, r.x) - quat_dot(r.y, r.y)) / (2.0f * product);
    tangent = 1.0f / (abs(cotangent) + sqrt(1.0f + cotangent * cotangent));
    if (cotangent < 0.0f) tangent = -tangent;
  }
  float cosine = 1.0f / sqrt(1.0f + tangent * tangent);
  float sine = cosine * tangent;
  float half_cosine = sqrt(0.5f + 0.5f * cosine);
  Quat rotated = quat_mul(r.rotation, quat_of(half_cosine, 0.0f, 0.0f, 0.5f * sine / half_cosine));
  RotatedRows out;
  out.x = quat_add(quat_scale(r.y, cosine), quat_scale(r.x, -sine));
  out.y = r.z;
  out.z = quat_add(quat_scale(r.x, cosine), quat_scale(r.y, sine));
  out.rotation = quat_of(rotated.w, rotated.y, rotated.z, rotated.x);
  return out;
}

// Returns the equivalent primitive of format/math. Its scales and rotation are those of the
// Gaussian whose covariance entries are the residual rows' dot products: the rows are rotated until
// they are orthogonal (Hestenes' one-sided Jacobi), which preserves the relative precision of the
// shortest axis. `tick`: units of time per tick.
STGS_FN CoupledPrimitive coupled_primitive(Coupled g, float tick) {
  CoupledRows r = coupled_rows(coupled_axes(g));
  float variance = quat_dot(r.t, r.t);
  Vec3 u = vec3_of(quat_dot(r.x, r.t) / variance, quat_dot(r.y, r.t) / variance,
                   quat_dot(r.z, r.t) / variance);
  RotatedRows residual;
  residual.x = quat_add(r.x, quat_scale(r.t, -u.x));
  residual.y = quat_add(r.y, quat_scale(r.t, -u.y));
  residual.z = quat_add(r.z, quat_scale(r.t, -u.z));
  residual.rotation = quat_of(1.0f, 0.0f, 0.0f, 0.0f);
  for (int step = 0; step < 18; ++step) residual = rotate_rows(residual);
  float min_variance = 1e-14f;  // of an axis, scene units^2
  CoupledPrimitive out;
  out.log_scale = vec3_of(0.5f * log(larger(quat_dot(residual.x, residual.x), min_variance)),
                          0.5f * log(larger(quat_dot(residual.y, residual.y), min_variance)),
                          0.5f * log(larger(quat_dot(residual.z, residual.z), min_variance)));
  out.rotation = quat_normalised(residual.rotation);
  out.u = vec3_of(u.x * tick, u.y * tick, u.z * tick);
  out.sigma = sqrt(2.0f * variance) / tick;
  return out;
}

struct CoupledPrimitiveGrad {
  Sym3 covariance;  // excludes the part in log_scale
  Vec3 log_scale;   // for example a regulariser's
  Vec3 u;
  float sigma;
};

// Backward of coupled_primitive to the parameters. Gradients of the standard deviations are with
// respect to their logarithms.
STGS_FN Coupled coupled_primitive_grad(Coupled g, float tick, Vec3 log_scale, Quat rotation,
                                       CoupledPrimitiveGrad by) {
  Conditional d;
  d.u = vec3_of(by.u.x * tick, by.u.y * tick, by.u.z * tick);
  d.sigma = by.sigma / tick;
  // d log s_k = axis_k' dV axis_k / (2 s_k^2); an off-diagonal entry stands for both positions.
  Mat3 a = rotation_of(rotation);
  float x = 0.5f * by.log_scale.x * exp(-2.0f * log_scale.x);
  float y = 0.5f * by.log_scale.y * exp(-2.0f * log_scale.y);
  float z = 0.5f * by.log_scale.z * exp(-2.0f * log_scale.z);
  d.covariance.xx = by.covariance.xx + x * a.xx * a.xx + y * a.xy * a.xy + z * a.xz * a.xz;
  d.covariance.yy = by.covariance.yy + x * a.yx * a.yx + y * a.yy * a.yy + z * a.yz * a.yz;
  d.covariance.zz = by.covariance.zz + x * a.zx * a.zx + y * a.zy * a.zy + z * a.zz * a.zz;
  d.covariance.xy = by.covariance.xy + 2.0f * (x * a.xx * a.yx + y * a.xy * a.yy + z * a.xz * a.yz);
  d.covariance.xz = by.covariance.xz + 2.0f * (x * a.xx * a.zx + y * a.xy * a.zy + z * a.xz * a.zz);
  d.covariance.yz = by.covariance.yz + 2.0f * (x * a.yx * a.zx + y * a.yy * a.zy + z * a.yz * a.zz);
  Coupled out = coupled_conditional_grad(g, d);
  out.time = out.time * g.time;
  out.scale = vec3_of(out.scale.x * g.scale.x, out.scale.y * g.scale.y, out.scale.z * g.scale.z);
  return out;
}

STGS_MATH_END

#endif
