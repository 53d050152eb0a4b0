// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "catch.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/sh.h"

using namespace stgs::math;

TEST_CASE("visibility is 1 within the radius and falls as a Gaussian beyond it") {
  CHECK(visibility(0.0f, 2.0f, 5.0f) == 1.0f);
  CHECK(visibility(-5.0f, 2.0f, 5.0f) == 1.0f);
  CHECK(visibility(7.0f, 2.0f, 5.0f) == Approx(std::exp(-1.0f)));
  CHECK(visibility(-9.0f, 2.0f, 5.0f) == Approx(std::exp(-4.0f)));
}

TEST_CASE("the support ends where the opacity reaches the threshold") {
  const float opacity = 0.7f, sigma = 3.0f, radius = 1.5f;
  const float half_width = support_half_width(opacity, sigma, radius, kAlphaThreshold);
  CHECK(opacity * visibility(half_width, sigma, radius) == Approx(kAlphaThreshold).epsilon(1e-4));
  CHECK(support_half_width(0.001f, sigma, radius, kAlphaThreshold) < 0.0f);
}

TEST_CASE("the modulation is at least 2 and grows with the square of the lifespan") {
  CHECK(lifespan_modulation(0.1f, 0.0f) == 2.0f);
  CHECK(lifespan_modulation(3.0f, 0.0f) == 10.0f);
  CHECK(lifespan_modulation(600.0f, 300.0f) == 810001.0f);
}

TEST_CASE("spherical harmonics of degree 1 to 3 are orthonormal over the sphere") {
  double product[16][16] = {};
  const int steps = 128;
  for (int i = 0; i < steps; ++i) {
    const double z = -1.0 + (i + 0.5) * 2.0 / steps;
    const double s = std::sqrt(1.0 - z * z);
    for (int j = 0; j < steps; ++j) {
      const double phi = (j + 0.5) * 2.0 * M_PI / steps;
      const ShBasis b =
          sh_basis(vec3_of(static_cast<float>(s * std::cos(phi)),
                           static_cast<float>(s * std::sin(phi)), static_cast<float>(z)));
      for (int m = 0; m < 16; ++m) {
        for (int n = 0; n < 16; ++n)
          product[m][n] += b.v[m] * b.v[n] * 4.0 * M_PI / (steps * steps);
      }
    }
  }
  for (int m = 0; m < 16; ++m) {
    for (int n = 0; n < 16; ++n) CHECK(product[m][n] == Approx(m == n ? 1.0 : 0.0).margin(2e-3));
  }
}

TEST_CASE("a Gaussian on the axis projects to the principal point with its size in pixels") {
  PinholeCamera camera{};
  camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  camera.translation = {0, 0, 0};
  camera.fx = camera.fy = 100.0f;
  camera.cx = 64.0f;
  camera.cy = 48.0f;
  camera.width = 128.0f;
  camera.height = 96.0f;
  camera.near_plane = 0.1f;
  const Sym3 covariance = covariance_of({1, 0, 0, 0}, {0.2f, 0.1f, 0.3f});
  const Projection p = project_gaussian(camera, {0, 0, 2}, covariance);
  REQUIRE(p.visible == 1);
  CHECK(p.mean.x == Approx(64.0f));
  CHECK(p.mean.y == Approx(48.0f));
  CHECK(p.covariance.xx == Approx(100.0f + kScreenBlur));
  CHECK(p.covariance.yy == Approx(25.0f + kScreenBlur));
  CHECK(p.covariance.xy == Approx(0.0f).margin(1e-5));
  CHECK(project_gaussian(camera, {0, 0, 0.05f}, covariance).visible == 0);
  const Vec2 extent = splat_extent(p.covariance, 0.5f, kAlphaThreshold);
  CHECK(splat_alpha(0.5f, splat_power(p.conic, extent.x * 0.999f, 0.0f)) > 0.0f);
  CHECK(splat_alpha(0.5f, splat_power(p.conic, extent.x * 1.001f, 0.0f)) == 0.0f);
}
