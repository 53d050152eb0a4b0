// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.h"
#include "stgs/format/math/project.h"
#include "turntable.h"

namespace stgs::tools {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kCentre[3] = {1, -2, 3};
constexpr double kDistance = 4, kHeight = 1.5;

// A camera at an azimuth around the vertical through kCentre, above it, that looks at it; y is
// down.
encoder::Camera camera_at(double azimuth) {
  encoder::Camera camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = camera.fy = 300;
  camera.cx = 160;
  camera.cy = 120;
  const double length = std::hypot(kDistance, kHeight);
  const double z[3] = {-std::sin(azimuth) * kDistance / length, kHeight / length,
                       -std::cos(azimuth) * kDistance / length};
  const double x[3] = {-std::cos(azimuth), 0, std::sin(azimuth)};
  const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2],
                       z[0] * x[1] - z[1] * x[0]};
  const double* axes[3] = {x, y, z};
  for (int r = 0; r < 3; ++r) {
    std::copy_n(axes[r], 3, camera.rotation + 3 * r);
    for (int k = 0; k < 3; ++k) camera.translation[r] -= axes[r][k] * (kCentre[k] - length * z[k]);
  }
  return camera;
}

encoder::PreparedCapture rig(double first, double last, int cameras) {
  encoder::PreparedCapture capture;
  std::copy_n(kCentre, 3, capture.scene_centre);
  for (int i = 0; i < cameras; ++i)
    capture.cameras.push_back(camera_at((first + (last - first) * i / (cameras - 1)) * kDegree));
  return capture;
}

struct Seen {
  double azimuth, distance, height;
};

// Checks that the camera looks at the centre, upright, and returns where it stands.
Seen seen_from(const encoder::Camera& camera) {
  const math::PinholeCamera pinhole = camera.pinhole(0.0f);
  const math::Vec3 centre = math::to_camera(pinhole, {1, -2, 3});
  CHECK(centre.z > 0);
  CHECK(std::abs(centre.x) < 1e-4);
  CHECK(std::abs(centre.y) < 1e-4);
  CHECK(std::abs(camera.rotation[1]) < 2e-3);  // the horizon is level
  CHECK(camera.rotation[4] > 0);
  const math::Vec3 at = math::camera_centre(pinhole);
  return {std::atan2(at.x - 1, at.z - 3) / kDegree, std::hypot(at.x - 1, at.z - 3), -2 - at.y};
}

}  // namespace

TEST_CASE("a rig on an arc is swept to and fro between its outermost cameras") {
  double least = 1e9, most = -1e9;
  for (const encoder::Camera& camera : turntable(rig(130, 230, 6), 40)) {
    Seen seen = seen_from(camera);
    if (seen.azimuth < 0) seen.azimuth += 360;
    least = std::min(least, seen.azimuth);
    most = std::max(most, seen.azimuth);
    CHECK(seen.distance == Approx(kDistance).epsilon(1e-3));
    CHECK(seen.height == Approx(kHeight).epsilon(2e-3));
  }
  CHECK(least == Approx(130).margin(0.2));
  CHECK(most == Approx(230).margin(0.2));
}

TEST_CASE("a rig all around the scene is turned once, in even steps") {
  const auto views = turntable(rig(0, 330, 12), 36);
  REQUIRE(views.size() == 36);
  for (std::size_t k = 0; k + 1 < views.size(); ++k) {
    const double step = seen_from(views[k + 1]).azimuth - seen_from(views[k]).azimuth;
    CHECK(std::abs(std::remainder(step, 360)) == Approx(10).epsilon(1e-3));
  }
}

TEST_CASE("one camera, or one above the scene, has a path without surprises") {
  encoder::PreparedCapture capture;
  capture.cameras = {camera_at(0.3)};
  std::copy_n(kCentre, 3, capture.scene_centre);
  for (const encoder::Camera& camera : turntable(capture, 8))
    CHECK(seen_from(camera).distance == Approx(kDistance).epsilon(1e-3));
  std::copy_n(capture.cameras[0].translation, 3, capture.scene_centre);  // anywhere
  for (int k = 0; k < 3; ++k) capture.cameras[0].translation[k] = -capture.scene_centre[k];
  for (const encoder::Camera& camera : turntable(capture, 8)) {
    for (double value : camera.rotation) CHECK(std::isfinite(value));
    for (double value : camera.translation) CHECK(std::isfinite(value));
  }
}

}  // namespace stgs::tools
