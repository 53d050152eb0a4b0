// SPDX-License-Identifier: Apache-2.0
// Sparse rigs: how sparse a rig is, the space that is empty in front of its cameras, and primitives
// there.
#include "train/free_space.h"

#include <cmath>
#include <filesystem>
#include <numbers>

#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "random_train_state.h"
#include "train/densify.h"
#include "train/initial_state.h"
#include "train/rig.h"
#include "train/training_choice.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

// A camera on a circle of radius 4 around the origin, at an angle in degrees, that looks inwards.
Camera camera_at(const std::string& name, double degrees) {
  const double angle = degrees * std::numbers::pi / 180, c = std::cos(angle), s = std::sin(angle);
  Camera camera;
  camera.name = name;
  camera.width = camera.height = 100;
  camera.fx = camera.fy = 100;
  camera.cx = camera.cy = 50;
  // Right, down, forward; the circle lies in the plane y = 0.
  const double rotation[9] = {s, 0, -c, 0, 1, 0, -c, 0, -s};
  std::copy_n(rotation, 9, camera.rotation);
  camera.translation[2] = 4;
  return camera;
}

PreparedCapture arc(int cameras, double spacing) {
  PreparedCapture capture;
  for (int i = 0; i < cameras; ++i)
    capture.cameras.push_back(camera_at("cam" + std::to_string(i), spacing * i));
  capture.frames = 2;
  return capture;
}

}  // namespace

TEST_CASE("rigs with many or with close cameras are not sparse") {
  CHECK(rig_sparsity(arc(10, 24)) == 1);
  CHECK(rig_sparsity(arc(8, 18)) == 1);
  CHECK(rig_sparsity(arc(27, 24)) == 0);
  CHECK(rig_sparsity(arc(15, 6)) == 0);
  CHECK(rig_sparsity(arc(1, 24)) == 0);
  const double between = rig_sparsity(arc(22, 24));
  CHECK(between > 0.4);
  CHECK(between < 0.6);
  PreparedCapture held_out = arc(20, 6);  // held-out cameras do not count
  for (std::size_t i = 0; i < 20; ++i) held_out.cameras[i].test = i % 4 != 0;
  CHECK(rig_sparsity(held_out) == 1);
}

TEST_CASE("space in front of cameras and between them is empty up to half the way to the scene") {
  PreparedCapture capture = arc(8, 24);
  const TemporaryFolder folder{};
  capture.folder = folder.path;
  std::vector<InitialPoint> points(2000);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].frame = -1;  // within 1 of the origin, 3 from the cameras
    for (int c = 0; c < 3; ++c) {
      Random random(3, i, RandomPurpose::kInitial);
      random.skip(static_cast<std::uint64_t>(c));
      points[i].position[c] = 1.1f * (random.uniform() - 0.5f);
    }
  }
  REQUIRE(write_points(capture.folder + "/points_static.ply", points).ok());
  REQUIRE(write_points(capture.folder + "/points_dynamic.ply", {}).ok());
  const Result<FreeSpace> space = find_free_space(capture);
  REQUIRE(space.ok());
  CHECK(space->count > 8);
  const auto at = [](double degrees, double radius) {
    const double angle = degrees * std::numbers::pi / 180;
    return math::Vec3{static_cast<float>(radius * std::cos(angle)), 0.0f,
                      static_cast<float>(radius * std::sin(angle))};
  };
  CHECK(in_free_space(*space, at(24, 3.5)));        // in front of a camera
  CHECK(in_free_space(*space, at(12, 3.5)));        // between two
  CHECK_FALSE(in_free_space(*space, at(24, 2.0)));  // near the scene
  CHECK_FALSE(in_free_space(*space, at(24, 4.5)));  // behind the camera
  CHECK_FALSE(in_free_space(*space, at(270, 3.5)));
  for (const InitialPoint& point : points) {
    REQUIRE_FALSE(in_free_space(*space, {point.position[0], point.position[1], point.position[2]}));
  }
  // Moving content that comes near in one of many frames is not removed, nor is a small object.
  for (const std::size_t count : {500u, 20u}) {
    std::vector<InitialPoint> moving(points.begin(), points.begin() + count);
    for (std::size_t i = 0; i < moving.size(); ++i) {
      moving[i].frame = 0;
      if (i % 10 == 0) moving[i].position[0] += 3.5f;  // a hand in front of the first camera
    }
    REQUIRE(write_points(capture.folder + "/points_dynamic.ply", moving).ok());
    const Result<FreeSpace> with_hand = find_free_space(capture);
    REQUIRE(with_hand.ok());
    CHECK_FALSE(in_free_space(*with_hand, at(0, 3.4)));
    CHECK(in_free_space(*with_hand, at(120, 3.5)));
    CHECK(fingerprint_of(*with_hand) != fingerprint_of(*space));
  }
  CHECK(find_free_space(arc(30, 10))->count == 0);
}

TEST_CASE("densification removes primitives from free space") {
  FreeSpace space;
  space.count = 1;
  space.views[0] = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}, 0.5f, 0.5f, 1.0f, 0.1f};
  for (const bool first_stage : {true, false}) {
    TrainState state = random_train_state(4, 5);
    for (std::size_t i = 0; i < 4; ++i) {
      state.set.opacity_logit[i] = 0.0f;
      std::fill_n(state.set.log_scale.begin() + 3 * static_cast<int>(i), 3, std::log(0.01f));
      const float positions[4][3] = {{0, 0, 2}, {0, 0, 0.5f}, {2, 0, 0.5f}, {0, 0, -0.5f}};
      std::copy_n(positions[i], 3, state.set.position.begin() + 3 * static_cast<int>(i));
    }
    HyperParameters parameters;
    parameters.replace_limit = 1;
    DensifyContext context;
    context.free_space = space;
    const DensifyCounts counts =
        first_stage ? grow(state, parameters, context) : replace(state, parameters, context);
    CHECK((first_stage ? counts.removed : counts.replaced) == 1);
    for (std::size_t i = 0; i < state.size(); ++i) {
      const float* p = &state.set.position[3 * i];
      CHECK_FALSE(in_free_space(space, {p[0], p[1], p[2]}));
    }
  }
}

TEST_CASE("L_n fades for dense rigs unless its weight is set") {
  TrainSettings settings;
  HyperParameters parameters;
  CHECK(growth_parameters(parameters, settings, arc(10, 24)).weight_normal ==
        parameters.weight_normal);
  CHECK(growth_parameters(parameters, settings, arc(22, 24)).weight_normal ==
        Approx(0.5 * parameters.weight_normal));
  CHECK(growth_parameters(parameters, settings, arc(30, 10)).weight_normal == 0);
  settings.overrides.emplace_back("weight_normal", "0.2");
  parameters.weight_normal = 0.2;
  CHECK(growth_parameters(parameters, settings, arc(30, 10)).weight_normal == 0.2);
}

TEST_CASE("a point with a normal starts as a disc on its surface") {
  PreparedCapture capture = arc(3, 24);
  const TemporaryFolder folder{};
  capture.folder = folder.path;
  const float normals[5][3] = {{0, 0, 1}, {0, 0, -1}, {1, 0, 0}, {0.6f, 0, -0.8f}, {0, 0, 0}};
  std::vector<InitialPoint> points(5);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].frame = -1;
    points[i].position[1] = 0.1f * static_cast<float>(i);
    std::copy_n(normals[i], 3, points[i].normal);
  }
  REQUIRE(write_points(capture.folder + "/points_static.ply", points).ok());
  REQUIRE(write_points(capture.folder + "/points_dynamic.ply", {}).ok());
  HyperParameters parameters;
  parameters.seen_background = 0;
  const Result<TrainState> state = initial_state(capture, parameters, {}, 1);
  REQUIRE(state.ok());
  REQUIRE(state->size() == 5);
  for (std::size_t i = 0; i < 5; ++i) {
    const float *q = &state->set.rotation[4 * i], *s = &state->set.log_scale[3 * i];
    const math::Mat3 r = math::rotation_of({q[0], q[1], q[2], q[3]});
    const float along = r.xz * normals[i][0] + r.yz * normals[i][1] + r.zz * normals[i][2];
    CHECK(s[0] == s[1]);
    CHECK(s[2] - s[0] == Approx(i == 4 ? 0.0f : std::log(0.2f)).margin(1e-5));
    if (i < 4) CHECK(std::abs(along) == Approx(1.0f).epsilon(1e-5));
  }
}
