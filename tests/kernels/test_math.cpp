// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <random>

#include "catch.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/colour.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/math/project.h"
#include "stgs/format/math/screen_splat.h"
#include "stgs/format/math/sh.h"

using namespace stgs::math;

TEST_CASE("visibility is 1 within the radius and falls as a Gaussian beyond it") {
  CHECK(visibility(0.0f, 2.0f, 5.0f) == 1.0f);
  CHECK(visibility(-5.0f, 2.0f, 5.0f) == 1.0f);
  CHECK(visibility(7.0f, 2.0f, 5.0f) == Approx(std::exp(-1.0f)));
  CHECK(visibility(-9.0f, 2.0f, 5.0f) == Approx(std::exp(-4.0f)));
}

TEST_CASE("colours of other encodings are converted to sRGB, and sRGB itself is unchanged") {
  const auto shown = [](Vec3 c, int primaries, int transfer) {
    return displayed(c, colour_encoding(primaries, transfer));
  };
  CHECK(colour_encoding(kPrimariesBt709, kTransferSrgb) == 0);
  CHECK(colour_encoding(99, kTransferSrgb) == 0);
  const Vec3 same = shown({-0.5f, 0.3f, 1.7f}, kPrimariesBt709, kTransferSrgb);
  CHECK((same.x == -0.5f && same.y == 0.3f && same.z == 1.7f));
  for (const int primaries : {kPrimariesBt709, kPrimariesBt2020, kPrimariesP3}) {
    const Vec3 white = shown({1.0f, 1.0f, 1.0f}, primaries, kTransferSrgb);
    CHECK(white.x == Approx(1.0f).margin(1e-4));
    CHECK(white.z == Approx(1.0f).margin(1e-4));
    const Vec3 grey = shown({0.5f, 0.5f, 0.5f}, primaries, kTransferBt709);
    CHECK(grey.y == Approx(0.5466f).margin(1e-3));
  }
  CHECK(shown({0.2140f, 0.2140f, 0.2140f}, kPrimariesBt709, kTransferLinear).x ==
        Approx(0.5f).margin(1e-3));
  // The green of Display P3 is outside BT.709: red and blue are clipped.
  const Vec3 green = shown({0.0f, 1.0f, 0.0f}, kPrimariesP3, kTransferSrgb);
  CHECK((green.x == 0.0f && green.z == 0.0f));
  CHECK(green.y == Approx(1.0f).margin(1e-6));
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

namespace {

// At the origin, along z.
PinholeCamera camera_on_axis() {
  PinholeCamera camera{};
  camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  camera.translation = {0, 0, 0};
  camera.fx = camera.fy = 100.0f;
  camera.cx = 64.0f;
  camera.cy = 48.0f;
  camera.width = 128.0f;
  camera.height = 96.0f;
  camera.near_plane = 0.1f;
  return camera;
}

}  // namespace

TEST_CASE("a Gaussian on the axis projects to the principal point with its size in pixels") {
  const PinholeCamera camera = camera_on_axis();
  const Sym3 covariance = covariance_of({1, 0, 0, 0}, {0.2f, 0.1f, 0.3f});
  const float blur = screen_blur(kDilated);
  const Projection p = project_gaussian(camera, {0, 0, 2}, covariance, blur);
  REQUIRE(p.visible == 1);
  CHECK(p.mean.x == Approx(64.0f));
  CHECK(p.mean.y == Approx(48.0f));
  CHECK(p.covariance.xx == Approx(100.0f + blur));
  CHECK(p.covariance.yy == Approx(25.0f + blur));
  CHECK(p.covariance.xy == Approx(0.0f).margin(1e-5));
  CHECK(project_gaussian(camera, {0, 0, 0.05f}, covariance, blur).visible == 0);
  const Vec2 extent = splat_extent(p.covariance, 0.5f, kAlphaThreshold);
  CHECK(splat_alpha(0.5f, splat_power(p.conic, extent.x * 0.999f, 0.0f)) > 0.0f);
  CHECK(splat_alpha(0.5f, splat_power(p.conic, extent.x * 1.001f, 0.0f)) == 0.0f);
}

TEST_CASE("a band-limited splat has the integral of its Gaussian at any size, and dilation adds") {
  const PinholeCamera camera = camera_on_axis();
  const float opacity = 0.02f;
  for (const float size : {0.1f, 0.3f, 1.0f, 4.0f}) {  // standard deviation, pixels
    const Sym3 covariance =
        covariance_of({0.9f, 0.1f, 0.2f, 0.4f}, {size / 100, 0.5f * size / 100, size / 100});
    const auto integral = [&](int kernel) {
      const Projection p = project_gaussian(camera, {0, 0, 1}, covariance, screen_blur(kernel));
      const double determinant =
          double{p.covariance.xx} * p.covariance.yy - double{p.covariance.xy} * p.covariance.xy;
      return splat_opacity(kernel, opacity, p) * std::sqrt(determinant);
    };
    const Projection sharp = project_gaussian(camera, {0, 0, 1}, covariance, 0.0f);
    const double expected = opacity * std::sqrt(double{sharp.covariance.xx} * sharp.covariance.yy -
                                                double{sharp.covariance.xy} * sharp.covariance.xy);
    INFO(size << " pixels");
    CHECK(integral(kBandLimited) == Approx(expected).epsilon(1e-4));
    CHECK(integral(kDilated) > (size < 1.0f ? 1.5 : 1.01) * expected);
  }
  // A Gaussian without an area has no integral.
  const Projection line =
      project_gaussian(camera, {0, 0, 1}, covariance_of({1, 0, 0, 0}, {1, 0, 1}), 0.1f);
  CHECK(line.visible == 1);
  CHECK(splat_opacity(kBandLimited, 1.0f, line) == 0.0f);
  CHECK(splat_box(camera, line, 0.0f).visible == 0);
}

namespace {

// A projection with the given standard deviations along axes turned by `angle`, computed in double
// precision.
struct DoubleSplat {
  Projection projection{};
  double xx = 0, xy = 0, yy = 0;  // the conic
};

DoubleSplat splat_of(double major, double minor, double angle) {
  const double c = std::cos(angle), s = std::sin(angle), a = major * major, b = minor * minor;
  DoubleSplat out;
  const double xx = c * c * a + s * s * b, xy = c * s * (a - b), yy = s * s * a + c * c * b;
  out.xx = yy / (a * b);
  out.xy = -xy / (a * b);
  out.yy = xx / (a * b);
  const auto sym2 = [](double x, double y, double z) {
    return Sym2{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
  };
  out.projection.covariance = sym2(xx, xy, yy);
  out.projection.conic = sym2(out.xx, out.xy, out.yy);
  out.projection.mean = {100.25f, 50.5f};
  out.projection.depth = 3.0f;
  out.projection.visible = 1;
  return out;
}

PinholeCamera camera_of_size(float width, float height) {
  PinholeCamera camera{};
  camera.width = width;
  camera.height = height;
  return camera;
}

}  // namespace

TEST_CASE("the constants of the screen splat are those of the alpha law, to base 2") {
  CHECK(kLog2E == static_cast<float>(1.0 / std::log(2.0)));
  CHECK(kLog2Threshold == static_cast<float>(std::log2(1.0 / 255.0)));
  CHECK(kLog2AlphaMax > std::log2(0.99));
  CHECK(std::exp2(kLog2AlphaMax) - 0.99 < 1e-6);
  CHECK(kReachMax > std::log(255.0));
}

TEST_CASE("a screen splat agrees with the alpha law in double precision") {
  std::mt19937 bits(3);
  const auto random = [&bits](double low, double high) {
    return low + (high - low) * (static_cast<double>(bits()) / 4294967296.0);
  };
  for (int round = 0; round < 2000; ++round) {
    const DoubleSplat given =
        splat_of(std::exp(random(-0.6, 5)), std::exp(random(-0.6, 2)), random(0, 3.2));
    const auto opacity = static_cast<float>(std::exp(random(-5.5, 0)));
    const SplatBox box = splat_box(camera_of_size(200, 100), given.projection, opacity);
    REQUIRE(box.visible == 1);
    const Vec3 colour{0.25f, 0.5f, 0.75f};
    const ScreenSplat s = screen_splat(given.projection, box.extent, opacity, colour);
    CHECK(s.peak == Approx(std::log2(static_cast<double>(opacity))).margin(1e-6));
    CHECK(s.mean.x == given.projection.mean.x);
    CHECK(s.colour.y == colour.y);
    CHECK(s.depth == given.projection.depth);
    const Sym2 conic = conic_of(s.falloff);
    CHECK(conic.xx == Approx(given.xx).epsilon(1e-6));
    CHECK(conic.xy == Approx(given.xy).epsilon(1e-6));
    CHECK(conic.yy == Approx(given.yy).epsilon(1e-6));

    const double dx = random(-1, 1) * box.extent.x, dy = random(-1, 1) * box.extent.y;
    const double power = 0.5 * (given.xx * dx * dx + given.yy * dy * dy) + given.xy * dx * dy;
    const double log2_falloff =
        dx * (s.falloff.xx * dx + s.falloff.xy * dy) + s.falloff.yy * dy * dy;
    const double terms = given.xx * dx * dx + given.yy * dy * dy + std::abs(given.xy * dx * dy);
    CHECK(log2_falloff == Approx(-power / std::log(2.0)).epsilon(0).margin(1e-6 * terms));

    // The box touches the ellipse on which alpha is the threshold, from outside.
    const double reach = 2.0 * std::log(255.0 * static_cast<double>(opacity));
    const double determinant = given.xx * given.yy - given.xy * given.xy;
    const double half_width = std::sqrt(reach * given.yy / determinant);
    const double half_height = std::sqrt(reach * given.xx / determinant);
    CHECK(box.extent.x >= half_width * (1.0 - 1e-6));
    CHECK(box.extent.y >= half_height * (1.0 - 1e-6));
    const double slack = 1.0 + 4e-6 * (1.0 + given.xx * given.projection.covariance.xx) + 1e-5;
    CHECK(box.extent.x <= half_width * slack);
    CHECK(box.extent.y <= half_height * slack);
  }
}

TEST_CASE("a splat outside the image or with a value that is not finite has no visible box") {
  const DoubleSplat given = splat_of(10.0, 4.0, 0.5);
  const PinholeCamera camera = camera_of_size(200, 100);
  REQUIRE(splat_box(camera, given.projection, 0.5f).visible == 1);
  const auto visible = [&](auto change) {
    Projection p = given.projection;
    change(p);
    return splat_box(camera, p, 0.5f).visible;
  };
  CHECK(visible([](Projection& p) { p.visible = 0; }) == 0);
  CHECK(visible([](Projection& p) { p.depth = INFINITY; }) == 0);
  CHECK(visible([](Projection& p) { p.mean.x = NAN; }) == 0);
  CHECK(visible([](Projection& p) { p.conic.xy = -INFINITY; }) == 0);
  CHECK(visible([](Projection& p) { p.covariance.xx = INFINITY; }) == 0);
  const float reach = splat_box(camera, given.projection, 0.5f).extent.x;
  CHECK(visible([&](Projection& p) { p.mean.x = -reach - 0.01f; }) == 0);
  CHECK(visible([&](Projection& p) { p.mean.x = -reach + 0.01f; }) == 1);
  CHECK(visible([&](Projection& p) { p.mean.x = 200.0f + reach + 0.01f; }) == 0);
  CHECK(visible([](Projection& p) { p.mean.y = 1000.0f; }) == 0);
}
