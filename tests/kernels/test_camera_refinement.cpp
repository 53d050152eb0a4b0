// SPDX-License-Identifier: Apache-2.0
// The updates of refined cameras: single cameras are corrected, the rig as a whole is not.
#include <algorithm>
#include <cmath>

#include "catch.h"
#include "train/camera_refinement.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

// Cameras on a circle of radius 4 around the centre of the scene, which they look at.
PreparedCapture ring(int cameras) {
  PreparedCapture capture;
  capture.scene_centre[2] = 1;
  for (int i = 0; i < cameras; ++i) {
    const double a = 2 * M_PI * i / cameras, c = std::cos(a), s = std::sin(a);
    Camera camera;
    camera.name = fmt::format("{}", i);
    camera.width = camera.height = 100;
    camera.fx = camera.fy = 100;
    camera.cx = camera.cy = 50;
    const double rotation[9] = {c, 0, -s, 0, 1, 0, s, 0, c};
    const double centre[3] = {-4 * s, 0, 1 - 4 * c};
    std::copy_n(rotation, 9, camera.rotation);
    for (int r = 0; r < 3; ++r) {
      for (int k = 0; k < 3; ++k) camera.translation[r] -= rotation[3 * r + k] * centre[k];
    }
    capture.cameras.push_back(camera);
  }
  return capture;
}

// The gradient that pulls a camera upwards, in the world and in its image.
constexpr math::CameraGrad kUpwards = {{0, 0, 0}, {0, 1, 0}, 0};

double largest(const CameraCorrection& correction) {
  double out = 0;
  for (float v : correction) out = std::max(out, std::abs(double{v}));
  return out;
}

}  // namespace

TEST_CASE("a correction that all cameras share is undone, and that of a single one is kept") {
  const int count = GENERATE(3, 4, 5, 8);
  CAPTURE(count);
  const PreparedCapture capture = ring(count);
  TrainState all, one;
  begin_refinement(capture.cameras.size(), all);
  begin_refinement(capture.cameras.size(), one);
  for (int step = 0; step < 20; ++step) {
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
      add_camera_gradient(all, c, kUpwards);
      add_camera_gradient(one, c, c == 1 ? kUpwards : math::CameraGrad{});
    }
    update_cameras(capture, 1e-3f, 0.5f, all);
    update_cameras(capture, 1e-3f, 0.5f, one);
  }
  for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
    CAPTURE(c);
    CHECK(largest(all.cameras[c]) < 1e-5);
    if (c == 1) CHECK(largest(one.cameras[c]) > 0.02);
    if (c != 1) CHECK(largest(one.cameras[c]) < 1e-6);
  }
}

TEST_CASE("weak evidence moves no camera") {
  const PreparedCapture capture = ring(5);
  TrainState state;
  begin_refinement(capture.cameras.size(), state);
  for (int step = 0; step < 40; ++step) {
    const float sign = step % 2 == 0 ? 1.0f : -0.9f;
    add_camera_gradient(state, 2, {{0, 0, 0}, {0, sign, 0}, 0});
    update_cameras(capture, 1e-3f, 0.7f, state);
  }
  CHECK(largest(state.cameras[2]) < 2e-3);
}
