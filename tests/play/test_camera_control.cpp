// SPDX-License-Identifier: Apache-2.0
// The viewer's camera: rotations stay valid and upright, and orbits keep their target.
#include <cmath>

#include "catch.h"
#include "play/camera_control.h"

using namespace stgs;
using namespace stgs::tools;

namespace {

stgs_scene_info scene_with(const Vector3& up) {
  stgs_scene_info scene{};
  for (int k = 0; k < 3; ++k) {
    scene.bounds_min[k] = -1;
    scene.bounds_max[k] = 1;
  }
  scene.up[0] = static_cast<float>(up.x);
  scene.up[1] = static_cast<float>(up.y);
  scene.up[2] = static_cast<float>(up.z);
  return scene;
}

// A camera five units in front of the centre of the scene.
encoder::Camera front_camera() {
  encoder::Camera camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = 300;
  camera.fy = 310;
  camera.cx = 170;
  camera.cy = 115;
  camera.translation[2] = 5;
  return camera;
}

constexpr Size kSize{320, 240};

Vector3 row(const encoder::Camera& camera, int index) {
  const double* r = camera.rotation + 3 * index;
  return {r[0], r[1], r[2]};
}

Vector3 in_camera(const encoder::Camera& camera, const Vector3& point) {
  const double* t = camera.translation;
  return Vector3{dot(row(camera, 0), point), dot(row(camera, 1), point),
                 dot(row(camera, 2), point)} +
         Vector3{t[0], t[1], t[2]};
}

Vector3 in_camera(const CameraControl& control, const Vector3& point) {
  return in_camera(control.camera(kSize), point);
}

Vector3 position(const CameraControl& control) {
  const encoder::Camera camera = control.camera(kSize);
  const double* t = camera.translation;
  return -1 * (t[0] * row(camera, 0) + t[1] * row(camera, 1) + t[2] * row(camera, 2));
}

void check_near(const Vector3& a, const Vector3& b) {
  CHECK(a.x == Approx(b.x).margin(1e-4));
  CHECK(a.y == Approx(b.y).margin(1e-4));
  CHECK(a.z == Approx(b.z).margin(1e-4));
}

// The rows are orthonormal and right-handed.
void check_rotation(const CameraControl& control) {
  const encoder::Camera camera = control.camera(kSize);
  const double* r = camera.rotation;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      const double dot =
          r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2];
      CHECK(dot == Approx(i == j ? 1.0 : 0.0).margin(1e-5));
    }
  }
  CHECK(r[0] * r[4] - r[1] * r[3] == Approx(r[8]).margin(1e-5));
}

}  // namespace

TEST_CASE("the initial camera is the start camera, and reset restores it") {
  CameraControl control(front_camera(), scene_with({0, -1, 0}));
  const auto same = [&] {
    const encoder::Camera now = control.camera(kSize), start = front_camera();
    CHECK(now.fx == start.fx);
    CHECK(now.fy == start.fy);
    CHECK(now.cx == start.cx);
    CHECK(now.cy == start.cy);
    for (int k = 0; k < 9; ++k) CHECK(now.rotation[k] == start.rotation[k]);
    for (int k = 0; k < 3; ++k) CHECK(now.translation[k] == start.translation[k]);
  };
  same();
  control.orbit(1, 0.5);
  control.look(0.3, 0.2);
  control.move(1, 2, 3);
  control.approach(0.5);
  control.reset();
  same();
  CHECK(control.distance() == Approx(5));
}

TEST_CASE("orbiting keeps the scene in the centre and at its distance") {
  CameraControl control(front_camera(), scene_with({0, -1, 0}));
  control.orbit(0.5, 0);
  CHECK(position(control).x == Approx(5 * std::sin(0.5)));  // to the right
  check_near(in_camera(control, {0, 0, 0}), {0, 0, 5});
  control.orbit(0, 0.4);
  CHECK(position(control).y == Approx(-5 * std::sin(0.4)));  // up is -y
  check_near(in_camera(control, {0, 0, 0}), {0, 0, 5});
  for (int k = 0; k < 5000; ++k) control.orbit(0.03, 0.01 * std::sin(k));
  check_near(in_camera(control, {0, 0, 0}), {0, 0, 5});
  check_rotation(control);
}

TEST_CASE("orbiting never passes over the top, for any up direction") {
  for (const Vector3 up : {Vector3{0, -1, 0}, Vector3{0, -0.8, -0.6}}) {
    CameraControl control(front_camera(), scene_with(up));
    for (int k = 0; k < 100; ++k) {
      control.orbit(0.1, 0.2);
      const encoder::Camera camera = control.camera(kSize);
      // The camera's y axis keeps pointing down.
      CHECK(camera.rotation[3] * up.x + camera.rotation[4] * up.y + camera.rotation[5] * up.z < 0);
    }
    check_near(in_camera(control, {0, 0, 0}), {0, 0, 5});
    check_rotation(control);
  }
}

TEST_CASE("looking around does not move the camera") {
  CameraControl control(front_camera(), scene_with({0, -1, 0}));
  const Vector3 start = position(control);
  control.look(0.3, 0);
  check_near(position(control), start);
  CHECK(in_camera(control, {0, 0, 0}).x < -1);  // the scene is on the left
  control.look(-0.3, 0.3);
  CHECK(in_camera(control, {0, 0, 0}).y > 1);  // and now below
  CHECK(control.distance() == Approx(5));
}

TEST_CASE("moving follows the camera's axes, and approaching never passes the target") {
  CameraControl control(front_camera(), scene_with({0, -1, 0}));
  control.look(3.14159265 / 2, 0);  // towards +x
  control.move(1, 2, 3);
  check_near(position(control), {3, -2, -5 - 1});
  control.reset();
  control.approach(0.5);
  check_near(position(control), {0, 0, -2.5});
  for (int k = 0; k < 200; ++k) control.approach(0.5);
  CHECK(control.distance() > 0);
  CHECK(in_camera(control, {0, 0, 0}).z > 0);
}

TEST_CASE("other sizes contain the start camera's view without stretching it") {
  const CameraControl control(front_camera(), scene_with({0, 0, 0}));
  for (const Size size : {Size{640, 480}, Size{1000, 240}, Size{100, 900}}) {
    const encoder::Camera camera = control.camera(size);
    CHECK(camera.fx / camera.fy == Approx(300.0 / 310));
    // The corners of the start camera's image are inside.
    const double scale = camera.fx / 300;
    CHECK(camera.cx - 170 * scale >= -1e-9);
    CHECK(camera.cy - 115 * scale >= -1e-9);
    CHECK(camera.cx + 150 * scale <= size.width + 1e-9);
    CHECK(camera.cy + 125 * scale <= size.height + 1e-9);
  }
}

TEST_CASE("the overview camera contains the complete scene") {
  for (const Vector3 up : {Vector3{0, 0, 0}, Vector3{0, 0, 1}, Vector3{0.6, 0.8, 0}}) {
    const stgs_scene_info scene = scene_with(up);
    const CameraControl control(overview(scene), scene);
    check_rotation(control);
    const encoder::Camera camera = overview(scene);
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3 p = in_camera(
          camera, {corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0});
      CHECK(std::abs(camera.fx * p.x / p.z) < camera.cx);
      CHECK(std::abs(camera.fy * p.y / p.z) < camera.cy);
    }
  }
}
