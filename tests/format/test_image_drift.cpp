// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "catch.h"
#include "stgs/format/image_drift.h"

using namespace stgs;

namespace {

// A camera at x = `offset` that looks along z. 200x100 pixels, with a focal length of 100 pixels.
math::PinholeCamera camera_at(float offset) {
  math::PinholeCamera camera{};
  camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  camera.translation = {-offset, 0, 0};
  camera.fx = camera.fy = 100;
  camera.cx = 100;
  camera.cy = 50;
  camera.width = 200;
  camera.height = 100;
  camera.near_plane = 0.1f;
  return camera;
}

struct Primitive {
  float x, y, z;
  float opacity;
  float velocity[3];  // scene units per tick
  float radius;       // half width of the lifespan, ticks; sigma is close to 0
};

// Eleven frames; every primitive is centred at the middle of the clip.
Scene scene_of(const std::vector<Primitive>& primitives) {
  Scene scene;
  scene.metadata.time_base = {1, 10};
  scene.metadata.frames = 11;
  Gaussians4D& set = scene.gaussians;
  set.resize(primitives.size());
  for (std::size_t i = 0; i < primitives.size(); ++i) {
    const Primitive& p = primitives[i];
    const float position[3] = {p.x, p.y, p.z};
    std::copy_n(position, 3, &set.position[3 * i]);
    std::copy_n(p.velocity, 3, &set.velocity[3 * i]);
    set.opacity_logit[i] = std::log(p.opacity / (1 - p.opacity));
    set.sigma[i] = 1e-3f;
    set.radius[i] = p.radius;
    set.time[i] = 5;
  }
  return scene;
}

}  // namespace

TEST_CASE("drift is the motion in pixels of visible primitives that last for the entire clip") {
  const std::vector<math::PinholeCamera> cameras = {camera_at(0), camera_at(1)};
  const Scene scene = scene_of({
      {0, 0, 4, 0.9f, {0, 0, 0}, 6},          // static
      {0, 0, 4, 0.3f, {0, 0.004f, 0}, 6},     // 0.04 units at distance 4: 1 pixel in both
      {0, 0, 4, 0.9f, {0, 9, 0}, 4},          // too short-lived
      {0, 0, 4, 1e-3f, {0, 9, 0}, 6},         // never visible
      {0, 0, -4, 0.9f, {0, 9, 0}, 6},         // behind the cameras
      {-4.1f, 0, 4, 0.9f, {0, 0.04f, 0}, 6},  // outside both images
  });
  const ImageDrift drift = image_drift(scene, cameras);
  CHECK(drift.primitives == 2);
  CHECK(drift.mean == Approx(0.5).epsilon(1e-4));
  CHECK(drift.opacity_weighted == Approx(0.3 / 1.2).epsilon(1e-4));
  CHECK(drift.within_bound == 1);
}

TEST_CASE("the drift of a primitive is its mean over the cameras that see it") {
  // Moves along z from distance 2 to 1, one unit to the side of the first camera: from pixel 150 to
  // 200, the first pixel outside the image. The second camera looks along the motion.
  const Scene along = scene_of({{1, 0, 1.5f, 0.9f, {0, 0, -0.1f}, 6}});
  CHECK(image_drift(along, {camera_at(0)}).mean == Approx(50).epsilon(1e-4));
  CHECK(image_drift(along, {camera_at(1)}).mean == Approx(0).margin(1e-3));
  CHECK(image_drift(along, {camera_at(0), camera_at(1)}).mean == Approx(25).epsilon(1e-4));
  // It is always outside the image of the third camera, which does not count.
  CHECK(image_drift(along, {camera_at(0), camera_at(-9)}).mean == Approx(50).epsilon(1e-4));
  CHECK(image_drift(along, {camera_at(-9)}).primitives == 0);
  // It crosses the near plane.
  CHECK(image_drift(scene_of({{0, 0, 1, 0.9f, {0, 0, -0.4f}, 6}}), {camera_at(0)}).primitives == 0);
}

TEST_CASE("coverage counts the cameras that see the centre of a primitive at its time") {
  const std::vector<math::PinholeCamera> cameras = {camera_at(0), camera_at(5), camera_at(100)};
  const Scene scene = scene_of({
      {2, 0, 4, 0.9f, {0, 0, 0}, 6},      // visible in the first two
      {-1, 0, 4, 0.9f, {0, 0, 0}, 6},     // visible in the first
      {100, 0, 4, 0.9f, {0, 0, 0}, 1},    // visible in the last
      {0, 9, 4, 0.9f, {0, 0, 0}, 6},      // above all images
      {2, 0, -4, 0.9f, {0, 0, 0}, 6},     // behind all cameras
      {2, 0, 0.05f, 0.9f, {0, 0, 0}, 6},  // in front of the near plane
  });
  const CameraCoverage coverage = camera_coverage(scene, cameras);
  CHECK(coverage.by_more == 1);
  CHECK(coverage.by_one == 2);
  CHECK(coverage.by_none == 3);

  // A primitive centred before the clip is tested at the start of the clip.
  Scene early = scene_of({{-8, 0, 4, 0.9f, {1, 0, 0}, 20}});
  early.gaussians.time[0] = -8;
  CHECK(camera_coverage(early, cameras).by_one == 1);
}

TEST_CASE("the median drift is that of the middle primitive") {
  std::vector<Primitive> primitives;
  for (int i = 0; i < 5; ++i) {
    primitives.push_back({0, 0, 1, 0.5f, {0, 1e-4f * static_cast<float>(i * i), 0}, 6});
  }
  const ImageDrift drift = image_drift(scene_of(primitives), {camera_at(0)});
  CHECK(drift.median == Approx(0.4).epsilon(1e-3));
  CHECK(drift.mean == Approx(0.6).epsilon(1e-3));
  CHECK(image_drift(scene_of({}), {camera_at(0)}).primitives == 0);
}
