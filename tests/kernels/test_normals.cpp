// SPDX-License-Identifier: Apache-2.0
// L_n: where it is 0, and its gradients against central differences through the reference renderer.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <span>

#include "backend/cpu/surface.h"
#include "catch.h"
#include "finite_differences.h"
#include "fixtures/loop_threads.h"
#include "math/grad.h"
#include "raster_scene.h"
#include "train/normal_loss.h"
#include "train_scene.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;
using math::Vec3;

namespace {

constexpr int kWidth = 43, kHeight = 29;

struct Problem {
  math::PinholeCamera camera = testing::scene_camera(kWidth, kHeight);
  RasterSettings settings;
  float t = 10.0f;
  float weight = 0.7f;
  Gaussians4D set;
  Image8 ground_truth;

  SplatFrame frame;
  RasterOutput output, surface;
  std::vector<math::Plane> planes;
  Image d_surface;
  NormalLoss normal_loss;
  Image fixed_alpha;  // if set, the alpha of L_n, which its gradients treat as constant

  double loss() {
    render(set, t, camera, settings, frame, output);
    cpu::find_planes(set, t, camera, frame, planes);
    cpu::blend_planes(settings, frame, planes, surface);
    for (std::size_t k = 0; k < fixed_alpha.data.size(); ++k) {
      surface.depth.data[k] *= surface.alpha.data[k] / fixed_alpha.data[k];
      surface.alpha.data[k] = fixed_alpha.data[k];
    }
    return weight * normal_loss.evaluate(surface, ground_truth, camera, weight, d_surface);
  }

  cpu::PrimitiveGradients gradients() {
    loss();
    Image none;
    none.reshape(output.colour.width, output.colour.height, 3);
    cpu::BlendBackwardScratch scratch;
    std::vector<cpu::SplatGradients> splats;
    std::vector<math::Plane> d_planes;
    const cpu::PlanesBackward backward{planes, d_surface, d_planes};
    cpu::blend_backward(frame, settings, output, none, nullptr, scratch, splats, &backward);
    cpu::PrimitiveGradients g;
    cpu::project_backward(set, t, camera, settings, frame, splats, g);
    cpu::planes_backward(set, t, camera, frame, d_planes, g);
    return g;
  }
};

Vec3 unit(Vec3 v) {
  return math::vec3_scale(v, 1.0f / std::sqrt(math::dot3(v, v)));
}

// A rotation that turns axis k to a direction in camera space.
math::Quat rotation_to(const math::PinholeCamera& camera, int k, Vec3 to) {
  const Vec3 world = math::mat3_transpose_mul(camera.rotation, unit(to));
  const Vec3 axis = {k == 0 ? 1.0f : 0.0f, k == 1 ? 1.0f : 0.0f, k == 2 ? 1.0f : 0.0f};
  const Vec3 c = math::cross3(axis, world);
  return {1.0f + math::dot3(axis, world), c.x, c.y, c.z};
}

void move_to(Problem& p, std::size_t i, Vec3 c) {
  const Vec3 x = math::mat3_transpose_mul(
      p.camera.rotation,
      {c.x - p.camera.translation.x, c.y - p.camera.translation.y, c.z - p.camera.translation.z});
  std::copy_n(&x.x, 3, &p.set.position[3 * i]);
}

// Few flat primitives, each larger than the image, one behind another, with different slants but
// none edge-on. No pixel is near the thresholds of alpha or of a surface, and no primitive is near
// a change of its shortest axis or of the side that faces the camera.
Problem make_problem(unsigned seed) {
  Problem p;
  p.settings.scalar = true;
  const std::size_t n = 7;
  p.set = testing::random_scene(n, p.camera, seed, {0, std::log(1.2f), 0.1f});
  p.ground_truth = testing::random_ground_truth(kWidth, kHeight, seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (std::size_t i = 0; i < n; ++i) {
    const float z = 2.0f + 0.6f * static_cast<float>(i);
    move_to(p, i, {z * 0.4f * (uniform(random) - 0.5f), z * 0.3f * (uniform(random) - 0.5f), z});
    const int axis = static_cast<int>(i % 3);
    for (int k = 0; k < 3; ++k) p.set.log_scale[3 * i + k] += std::log(z);
    p.set.log_scale[3 * i + axis] -= 1.5f;
    const float side = i % 2 ? 1.0f : -1.0f;
    const math::Quat q = rotation_to(
        p.camera, axis, {1.2f * (uniform(random) - 0.5f), 1.2f * (uniform(random) - 0.5f), side});
    const float length = 0.7f + uniform(random);
    std::copy_n(&q.w, 4, &p.set.rotation[4 * i]);
    for (int k = 0; k < 4; ++k) p.set.rotation[4 * i + k] *= length;
    p.set.opacity_logit[i] = -0.5f + uniform(random);
    p.set.sigma[i] = 1.0f + uniform(random);
    p.set.radius[i] = 1.0f + uniform(random);
    const float offset = i % 2 ? 0.7f * p.set.radius[i] : p.set.radius[i] + 0.3f * p.set.sigma[i];
    p.set.time[i] = p.t + (i % 4 < 2 ? offset : -offset);
    for (int k = 0; k < 3; ++k) p.set.velocity[3 * i + k] = 0.05f * (uniform(random) - 0.5f);
  }
  return p;
}

void check(Problem& p, const char* name, std::span<float> values, std::span<const float> gradient,
           float step) {
  testing::check_gradient(p, name, values, gradient, step, 1.5e-2);
}

}  // namespace

TEST_CASE("gradients of L_n match finite differences in every parameter") {
  for (unsigned seed : {1u, 2u, 3u}) {
    Problem p = make_problem(seed);
    const double loss = p.loss();
    REQUIRE(p.frame.splats.size() == p.set.size());
    REQUIRE(*std::min_element(p.output.alpha.data.begin(), p.output.alpha.data.end()) > 0.6f);
    CHECK(loss > 0.01);
    for (bool scalar : {true, false}) {
      RasterSettings settings = p.settings;
      p.settings.scalar = scalar;
      const cpu::PrimitiveGradients g = p.gradients();
      p.settings = settings;
      p.fixed_alpha = p.surface.alpha;
      check(p, "position", p.set.position, g.position, 2e-3f);
      check(p, "log_scale", p.set.log_scale, g.log_scale, 8e-3f);
      check(p, "rotation", p.set.rotation, g.rotation, 5e-3f);
      check(p, "opacity_logit", p.set.opacity_logit, g.opacity_logit, 1e-2f);
      check(p, "time", p.set.time, g.time, 8e-3f);
      check(p, "velocity", p.set.velocity, g.velocity, 3e-3f);
      check(p, "sigma", p.set.sigma, g.sigma, 8e-3f);
      check(p, "radius", p.set.radius, g.radius, 8e-3f);
    }
  }
}

TEST_CASE("a plane renders its own normal and depth, whichever way its axis points") {
  for (const float side : {1.0f, -1.0f}) {
    Problem p;
    p.set = testing::random_scene(1, p.camera, 3, {0, 0.0f, 0.0f});
    p.ground_truth = testing::random_ground_truth(kWidth, kHeight, 1);
    move_to(p, 0, {0.1f, -0.05f, 3.0f});
    const float scales[3] = {2.0f, 2.0f, -3.0f};
    std::copy_n(scales, 3, p.set.log_scale.begin());
    const Vec3 normal = unit({0.5f, -0.3f, -1.0f});
    const math::Quat q = rotation_to(p.camera, 2, math::vec3_scale(normal, side));
    std::copy_n(&q.w, 4, p.set.rotation.begin());
    p.set.opacity_logit[0] = 6.0f;
    p.set.time[0] = p.t;
    std::fill(p.set.velocity.begin(), p.set.velocity.end(), 0.0f);
    CHECK(p.loss() < 2e-3);
    CHECK(p.planes[0].normal.z == Approx(normal.z));
    const float centre_distance = math::dot3(normal, {0.1f, -0.05f, 3.0f});
    CHECK(p.planes[0].distance == Approx(centre_distance));
    // A corner of the image, whose depth differs much from that of the centre.
    const Vec3 ray = math::pixel_ray(p.camera, 2.5f, 3.5f);
    CHECK(math::plane_depth(p.planes[0], 1.0f, ray) ==
          Approx(centre_distance / math::dot3(normal, ray)));
    CHECK(math::plane_depth(p.planes[0], 0.4f, ray) == 0.0f);
  }
}

TEST_CASE(
    "pixels at the border, without a surface or on an edge of the ground truth do not contribute") {
  Problem p = make_problem(5);
  const double all = p.loss();
  for (float g : {p.d_surface.plane(0)[0], p.d_surface.plane(3)[0]}) CHECK(g == 0.0f);
  // A black ground truth, then one whose right part is red. The two columns at the edge have the
  // largest gradient, all others the smallest.
  std::fill(p.ground_truth.data.begin(), p.ground_truth.data.end(), std::uint8_t{0});
  const double flat = p.loss();
  CHECK(flat > all);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 20; x < kWidth; ++x) p.ground_truth.data[3 * (y * kWidth + x)] = 255;
  }
  const double with_edge = p.loss();
  CHECK(with_edge < flat);
  CHECK(with_edge > 0.9 * flat);
  CHECK(p.d_surface.plane(0)[14 * kWidth + 1] != 0.0f);
  // Almost transparent: alpha is below the threshold everywhere.
  for (float& logit : p.set.opacity_logit) logit = -3.5f;
  CHECK(p.loss() == 0.0);
  for (float g : p.d_surface.data) CHECK(g == 0.0f);
  // Images without a pixel inside the border.
  for (const auto& [w, h] : {std::pair{2, 9}, {9, 2}, {1, 1}}) {
    Problem tiny = make_problem(6);
    tiny.camera = testing::scene_camera(w, h);
    tiny.ground_truth = testing::random_ground_truth(w, h, 1);
    CHECK(tiny.loss() == 0.0);
  }
}

namespace {

void compare_planes_with_reference() {
  const auto camera = testing::scene_camera(107, 61);
  Problem problems[2];
  cpu::PrimitiveGradients gradients[2];
  double losses[2];
  for (bool scalar : {true, false}) {
    Problem& p = problems[scalar];
    p.camera = camera;
    p.ground_truth = testing::random_ground_truth(107, 61, 3);
    p.set = testing::random_scene(800, camera, 9, {1, -1.5f, 0.5f});
    p.settings.scalar = scalar;
    losses[scalar] = p.loss();
    // Both use the same image, since depths of neighbours are differences of large numbers.
    if (!scalar) p.surface = problems[1].surface;
    gradients[scalar] = p.gradients();
  }
  CHECK(losses[0] == Approx(losses[1]).epsilon(1e-3));
  const auto difference = [](const std::vector<float>& a, const std::vector<float>& b) {
    double square = 0, length = 0;
    for (std::size_t k = 0; k < a.size(); ++k) {
      square += std::pow(static_cast<double>(a[k]) - b[k], 2);
      length += std::pow(static_cast<double>(b[k]), 2);
    }
    return std::sqrt(square / length);
  };
  INFO(vector_target());
  CHECK(difference(gradients[0].position, gradients[1].position) < 2e-2);
  CHECK(difference(gradients[0].rotation, gradients[1].rotation) < 2e-2);
  CHECK(difference(gradients[0].opacity_logit, gradients[1].opacity_logit) < 2e-2);
}

}  // namespace

TEST_CASE("the backward pass of planes on every vector target matches the scalar reference") {
  testing::for_each_vector_target(compare_planes_with_reference);
}

TEST_CASE("one thread and two give bit-identical values and gradients of L_n") {
  cpu::PrimitiveGradients gradients[2];
  double losses[2];
  for (int threads : {1, 2}) {
    const testing::LoopThreads limit(threads);
    Problem p;
    p.camera = testing::scene_camera(320, 180);
    p.ground_truth = testing::random_ground_truth(320, 180, 3);
    p.set = testing::random_scene(5000, p.camera, 41, {1, -2.5f, 0.5f});
    losses[threads - 1] = p.loss();
    gradients[threads - 1] = p.gradients();
  }
  CHECK(losses[0] > 0.0);
  CHECK(losses[0] == losses[1]);
  CHECK(gradients[0].position == gradients[1].position);
  CHECK(gradients[0].rotation == gradients[1].rotation);
  CHECK(gradients[0].sigma == gradients[1].sigma);
}

TEST_CASE("training steps with L_n bring normals and depth together") {
  Problem p = make_problem(8);
  TrainState state = testing::train_state(p.set, 1);
  StepInput input = testing::train_step(p.camera, p.ground_truth, p.t, 0);
  input.weight_l1 = input.weight_ssim = 0.0f;
  input.weight_lifespan = input.weight_opacity = input.weight_scale = 0.0f;
  input.weight_normal = 0.1f;
  input.rates[kOpacity] = 0.0f;
  const auto backend = make_cpu_backend();
  REQUIRE(backend->reserve({}).ok());
  REQUIRE(backend->begin(state).ok());
  for (int s = 0; s < 100; ++s) REQUIRE(backend->step(input).ok());
  const Result<std::vector<StepOutput>> outputs = backend->read();
  REQUIRE(outputs.ok());
  CHECK(outputs->front().loss == Approx(0.1 * outputs->front().normal));
  CHECK(outputs->back().normal < 0.7 * outputs->front().normal);
  input.weight_normal = 0.0f;
  REQUIRE(backend->step(input).ok());
  CHECK(backend->read()->front().normal == 0.0);
}
