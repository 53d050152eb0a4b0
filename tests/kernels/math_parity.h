// SPDX-License-Identifier: Apache-2.0
// Evaluates every function of format/math on one primitive, in the subset of C++, CUDA and GLSL
// that all three compile, so that they run the same source.
#ifndef STGS_TESTS_MATH_PARITY_H
#define STGS_TESTS_MATH_PARITY_H

#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/screen_splat.h"
#include "stgs/format/math/sh.h"
#include "stgs/format/math/surface.h"

STGS_MATH_BEGIN

// All members are scalars, so std430 and C++ lay the structs out identically.
struct ParityInput {
  Vec3 position;  // X, scene units
  Vec3 velocity;  // v, before the division by f
  Quat rotation;
  Vec3 log_scale;
  float opacity_logit;
  float dt;  // t - T, ticks
  float sigma;
  float radius;
  Vec2 offset;   // pixel offset from the mean, relative to the extent
  float sh[48];  // 16 coefficients of red, then green, then blue
  PinholeCamera camera;
};

struct ParityResult {
  float modulation;
  Vec3 position;  // X_t
  float visibility;
  float opacity;
  float support;
  float coverage;  // of the band-limited splat
  Sym3 covariance;
  Projection projection;
  Vec2 extent;
  SplatBox box;     // for an opacity of at least kAlphaThreshold, as the following
  Falloff falloff;  // of the ScreenSplat, as is peak
  float peak;
  float basis[16];
  Vec3 colour;
  float power;
  float alpha;
  Plane plane;
  float plane_depth;    // of this primitive alone, at the pixel of its centre
  Vec3 surface_normal;  // from two difference vectors in the plane
  float flatness;
};

STGS_FN ParityResult evaluate_parity(ParityInput g) {
  ParityResult r;
  r.modulation = lifespan_modulation(g.sigma, g.radius);
  Vec3 u = vec3_of(g.velocity.x / r.modulation, g.velocity.y / r.modulation,
                   g.velocity.z / r.modulation);
  r.position = position_at(g.position, u, g.dt);
  r.visibility = visibility(g.dt, g.sigma, g.radius);
  r.opacity = opacity_of(g.opacity_logit);
  r.support = support_half_width(r.opacity, g.sigma, g.radius, kAlphaThreshold);
  r.covariance = covariance_of(g.rotation,
                               vec3_of(exp(g.log_scale.x), exp(g.log_scale.y), exp(g.log_scale.z)));
  r.projection = project_gaussian(g.camera, r.position, r.covariance, screen_blur(kDilated));
  Projection band = project_gaussian(g.camera, r.position, r.covariance, screen_blur(kBandLimited));
  r.coverage = splat_opacity(kBandLimited, 1.0f, band);
  float opacity_t = r.opacity * r.visibility;
  r.extent = splat_extent(r.projection.covariance, opacity_t, kAlphaThreshold);
  float shown = larger(opacity_t, kAlphaThreshold);
  r.box = splat_box(g.camera, r.projection, shown);
  ScreenSplat splat = screen_splat(r.projection, r.box.extent, shown, vec3_of(0.0f, 0.0f, 0.0f));
  r.falloff = splat.falloff;
  r.peak = splat.peak;
  Vec3 centre = camera_centre(g.camera);
  Vec3 d = vec3_of(r.position.x - centre.x, r.position.y - centre.y, r.position.z - centre.z);
  float n = 1.0f / sqrt(dot3(d, d));
  ShBasis b = sh_basis(vec3_of(d.x * n, d.y * n, d.z * n));
  Vec3 sum = vec3_of(0.0f, 0.0f, 0.0f);
  for (int k = 0; k < kShMaxCoefficients; ++k) {
    r.basis[k] = b.v[k];
    sum.x += b.v[k] * g.sh[k];
    sum.y += b.v[k] * g.sh[16 + k];
    sum.z += b.v[k] * g.sh[32 + k];
  }
  r.colour = vec3_of(sh_colour(sum.x), sh_colour(sum.y), sh_colour(sum.z));
  r.power = splat_power(r.projection.conic, g.offset.x * larger(r.extent.x, 0.0f),
                        g.offset.y * larger(r.extent.y, 0.0f));
  r.alpha = splat_alpha(opacity_t, r.power);
  r.plane = primitive_plane(g.camera, r.position, g.rotation, g.log_scale);
  Vec3 ray = pixel_ray(g.camera, r.projection.mean.x, r.projection.mean.y);
  r.plane_depth = plane_depth(r.plane, 1.0f, ray);
  Vec3 x = cross3(r.plane.normal, ray);
  r.surface_normal = surface_normal(cross3(r.plane.normal, x), x);
  r.flatness = flatness_weight(g.offset.x);
  return r;
}

STGS_MATH_END

#endif
