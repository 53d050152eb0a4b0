// SPDX-License-Identifier: Apache-2.0
// Backward pass of the projection to the camera, in the same subset of C++, CUDA and GLSL as
// grad.h, whose conventions apply.
#ifndef STGS_ENCODER_MATH_CAMERA_GRAD_H
#define STGS_ENCODER_MATH_CAMERA_GRAD_H

#include "grad.h"

STGS_MATH_BEGIN

// Gradient with respect to a small motion of the camera, which takes a camera point c to
// c + rotation x c + translation, to the logarithm of both focal lengths, to the distortion of
// the lens (lens.h), of which the change of shapes is left out, and to the time of the view.
struct CameraGrad {
  Vec3 rotation;     // radians, camera axes
  Vec3 translation;  // scene units, camera axes
  float log_focal;
  float distortion;
  float time;  // frames
};

// Returns the gradient through project_gaussian and through the direction of view, on which the
// colour depends, without that of the time. `by`: the result of project_gaussian_grad for the same
// inputs. `by_direction`: gradient of the position through the colour, world space.
STGS_FN CameraGrad project_gaussian_camera_grad(PinholeCamera camera, Vec3 mean, Sym3 covariance,
                                                Sym2 conic, SplatShapeGrad grad, ProjectionGrad by,
                                                Vec3 by_direction) {
  Vec3 c = to_camera(camera, mean);
  ProjectionRows j = projection_rows(camera, c);
  Vec3 su = sym3_mul(covariance, j.u);
  Vec3 sv = sym3_mul(covariance, j.v);
  Sym2 sharp;
  sharp.xx = dot3(j.u, su);
  sharp.xy = dot3(j.u, sv);
  sharp.yy = dot3(j.v, sv);
  Sym2 d = screen_covariance_grad(sharp, conic, grad);
  Vec3 by_c = mat3_mul(camera.rotation, by.position);
  // Turning the camera turns mean and covariance S around it: dS = [w] S - S [w], so that the
  // gradient is the skew part of 2 G S, where G is the full symmetric gradient of S.
  Sym3 g;
  g.xx = 2.0f * by.covariance.xx;
  g.xy = by.covariance.xy;
  g.xz = by.covariance.xz;
  g.yy = 2.0f * by.covariance.yy;
  g.yz = by.covariance.yz;
  g.zz = 2.0f * by.covariance.zz;
  Vec3 x = sym3_mul(g, vec3_of(covariance.xx, covariance.xy, covariance.xz));
  Vec3 y = sym3_mul(g, vec3_of(covariance.xy, covariance.yy, covariance.yz));
  Vec3 z = sym3_mul(g, vec3_of(covariance.xz, covariance.yz, covariance.zz));
  Vec3 turn = mat3_mul(camera.rotation, vec3_of(y.z - z.y, z.x - x.z, x.y - y.x));
  CameraGrad out;
  out.rotation = vec3_add(cross3(c, by_c), turn);
  out.translation = vec3_add(by_c, mat3_mul(camera.rotation, by_direction));
  float iz = 1.0f / c.z;
  out.log_focal = grad.mean.x * camera.fx * c.x * iz + grad.mean.y * camera.fy * c.y * iz +
                  2.0f * (d.xx * sharp.xx + d.xy * sharp.xy + d.yy * sharp.yy);
  float x0 = c.x * iz;
  float y0 = c.y * iz;
  out.distortion =
      (grad.mean.x * camera.fx * x0 + grad.mean.y * camera.fy * y0) * (x0 * x0 + y0 * y0);
  out.time = 0.0f;
  return out;
}

STGS_MATH_END

#endif
