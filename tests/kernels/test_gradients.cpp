// SPDX-License-Identifier: Apache-2.0
// Compares the gradient of every parameter with central differences through the reference renderer.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>
#include <span>

#include "backend/cpu/blend_backward.h"
#include "backend/cpu/project_backward.h"
#include "catch.h"
#include "finite_differences.h"
#include "fixtures/loop_threads.h"
#include "raster_scene.h"
#include "stgs/format/math/lifespan.h"
#include "train/camera_refinement.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder::cpu;

namespace {

// The parameters that a trainer optimises: the set, with v in place of u = v / f. f stays that of
// the initial lifespans, since the trainer preserves the motion when lifespans change.
struct Model {
  Gaussians4D set;
  std::vector<float> v, f;

  void derive() {
    for (std::size_t k = 0; k < v.size(); ++k) set.velocity[k] = v[k] / f[k / 3];
  }
};

struct Problem {
  math::PinholeCamera camera = testing::scene_camera(43, 29);
  RasterSettings settings;
  float t = 10.0f;
  Model model;
  Image weights;  // the loss is the sum of their products with the colours
  SplatFrame frame;
  RasterOutput output;

  double loss() {
    model.derive();
    render(model.set, t, camera, settings, frame, output);
    double sum = 0;
    for (std::size_t k = 0; k < weights.data.size(); ++k)
      sum += static_cast<double>(weights.data[k]) * output.colour.data[k];
    return sum;
  }
};

// Moves primitive i to a point in camera space.
void move_to(Problem& p, std::size_t i, math::Vec3 c) {
  const math::Vec3 x = math::mat3_transpose_mul(
      p.camera.rotation,
      {c.x - p.camera.translation.x, c.y - p.camera.translation.y, c.z - p.camera.translation.z});
  p.model.set.position[3 * i] = x.x;
  p.model.set.position[3 * i + 1] = x.y;
  p.model.set.position[3 * i + 2] = x.z;
}

// Few splats, each larger than the image, so that a small step moves no pixel across the alpha
// threshold, where the loss is discontinuous.
Problem make_problem(unsigned seed) {
  Problem p;
  p.settings.scalar = true;
  p.settings.background = {0.3f, 0.1f, 0.6f};
  const std::size_t n = 9;
  p.model.set = testing::random_scene(n, p.camera, seed, {3, std::log(0.7f), 0.25f});
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  Gaussians4D& set = p.model.set;
  for (std::size_t i = 0; i < n; ++i) {
    set.opacity_logit[i] = -0.8f + uniform(random);
    for (int k = 0; k < 3; ++k) {
      set.sh[48 * i + k] = 0.8f + 0.8f * uniform(random);
      p.model.v.push_back(0.1f * normal(random));
    }
    // Quaternions of different lengths, all long compared with the step.
    float* q = &set.rotation[4 * i];
    const float length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const float target = 1.0f + uniform(random);
    for (int k = 0; k < 4; ++k) q[k] *= target / length;
    // One channel is below 0, where the clamp makes the gradient 0.
    if (i == 2) set.sh[48 * i + 1] = -4.0f;
    // At t, half of them are on the flat top of their lifespan and half on its slope; none is near
    // the kink.
    set.sigma[i] = 1.0f + uniform(random);
    set.radius[i] = 1.0f + uniform(random);
    const float offset = i % 2 ? 0.7f * set.radius[i] : set.radius[i] + 0.6f * set.sigma[i];
    set.time[i] = p.t + (i % 4 < 2 ? offset : -offset);
  }
  // Equal screen sizes at all distances, and distances that no step reorders. The first primitive
  // lies outside the frustum margin, where the slope of the projection is clamped.
  for (std::size_t i = 0; i < n; ++i) {
    math::Vec3 c = math::to_camera(
        p.camera, {set.position[3 * i], set.position[3 * i + 1], set.position[3 * i + 2]});
    const float z = 1.7f + 0.5f * static_cast<float>(i);
    c = i == 0 ? math::Vec3{-0.85f * z, 0.1f * z, z} : math::Vec3{c.x / c.z * z, c.y / c.z * z, z};
    move_to(p, i, c);
    for (int k = 0; k < 3; ++k) set.log_scale[3 * i + k] += std::log(z);
  }
  for (std::size_t i = 0; i < n; ++i)
    p.model.f.push_back(math::lifespan_modulation(set.sigma[i], set.radius[i]));
  p.model.v[0] = p.model.v[1] = p.model.v[2] = 0.0f;

  p.weights.reshape(43, 29, 3);
  for (float& w : p.weights.data) w = normal(random);
  return p;
}

void check(Problem& p, const char* name, std::span<float> values, std::span<const float> gradient,
           float step) {
  testing::check_gradient(p, name, values, gradient, step, 5e-3);
}

}  // namespace

TEST_CASE("gradients of every parameter match finite differences") {
  for (bool scalar : {true, false}) {
    for (unsigned seed : {1u, 2u, 3u}) {
      Problem p = make_problem(seed);
      p.settings.kernel = seed == 1 ? math::kDilated : math::kBandLimited;
      p.loss();
      REQUIRE(p.frame.splats.size() == p.model.set.size());
      RasterSettings settings = p.settings;
      settings.scalar = scalar;
      BlendBackwardScratch scratch;
      std::vector<SplatGradients> splats;
      PrimitiveGradients g;
      blend_backward(p.frame, settings, p.output, p.weights, nullptr, scratch, splats);
      project_backward(p.model.set, p.t, p.camera, settings, p.frame, splats, g);
      modulation_backward(p.model.set, p.frame, g);
      Gaussians4D& set = p.model.set;
      check(p, "position", set.position, g.position, 5e-3f);
      check(p, "log_scale", set.log_scale, g.log_scale, 8e-3f);
      check(p, "rotation", set.rotation, g.rotation, 2e-2f);
      check(p, "opacity_logit", set.opacity_logit, g.opacity_logit, 1e-2f);
      check(p, "sh", set.sh, g.sh, 1e-2f);
      check(p, "time", set.time, g.time, 8e-3f);
      check(p, "velocity", p.model.v, g.velocity, 3e-2f);
      check(p, "sigma", set.sigma, g.sigma, 8e-3f);
      check(p, "radius", set.radius, g.radius, 8e-3f);
    }
  }
}

namespace {

// A band-limited splat of about a pixel, with a loss of its mean, conic and coverage.
struct SplatProblem {
  math::PinholeCamera camera = testing::scene_camera(43, 29);
  std::vector<float> position, covariance;
  math::SplatShapeGrad grad{{0.3f, -0.2f}, {0.1f, 0.25f, -0.15f}, 0.8f, 0.0f};

  math::Projection project() const {
    const std::vector<float>& s = covariance;
    return math::project_gaussian(camera, {position[0], position[1], position[2]},
                                  {s[0], s[1], s[2], s[3], s[4], s[5]},
                                  math::screen_blur(math::kBandLimited));
  }
  double loss() const {
    const math::Projection p = project();
    return double{grad.mean.x} * p.mean.x + double{grad.mean.y} * p.mean.y +
           double{grad.conic.xx} * p.conic.xx + double{grad.conic.xy} * p.conic.xy +
           double{grad.conic.yy} * p.conic.yy + grad.log_coverage * std::log(double{p.coverage});
  }
};

}  // namespace

TEST_CASE("the gradient of a band-limited splat matches finite differences") {
  for (const float size : {0.3f, 1.0f, 3.0f}) {  // pixels
    SplatProblem p;
    const math::Vec3 c{0.4f, -0.2f, 2.5f};
    const math::Vec3 x = math::mat3_transpose_mul(
        p.camera.rotation,
        {c.x - p.camera.translation.x, c.y - p.camera.translation.y, c.z - p.camera.translation.z});
    const float s = size * c.z / p.camera.fx;
    const math::Sym3 v = math::covariance_of({0.8f, 0.3f, -0.2f, 0.5f}, {s, 0.6f * s, 1.5f * s});
    p.position = {x.x, x.y, x.z};
    p.covariance = {v.xx, v.xy, v.xz, v.yy, v.yz, v.zz};
    const math::Projection projection = p.project();
    p.grad.coverage = projection.coverage;
    const math::ProjectionGrad g =
        math::project_gaussian_grad(p.camera, x, v, projection.conic, p.grad);
    const float by_position[] = {g.position.x, g.position.y, g.position.z};
    const math::Sym3& d = g.covariance;
    const float by_covariance[] = {d.xx, d.xy, d.xz, d.yy, d.yz, d.zz};
    INFO(size << " pixels");
    testing::check_gradient(p, "position", std::span<float>(p.position), by_position, 5e-3f, 5e-3);
    testing::check_gradient(p, "covariance", std::span<float>(p.covariance), by_covariance,
                            0.01f * s * s, 5e-3);
  }
}

namespace {

// A problem whose camera has a correction, at 0 when its gradient is computed.
struct CameraProblem {
  Problem problem;
  encoder::Camera camera;
  encoder::CameraCorrection correction{};

  double loss() {
    problem.camera = encoder::corrected(camera, correction).pinhole(problem.camera.near_plane);
    return problem.loss();
  }
};

encoder::Camera camera_of(const math::PinholeCamera& pinhole) {
  encoder::Camera camera;
  camera.width = static_cast<int>(pinhole.width);
  camera.height = static_cast<int>(pinhole.height);
  camera.fx = pinhole.fx;
  camera.fy = pinhole.fy;
  camera.cx = pinhole.cx;
  camera.cy = pinhole.cy;
  const math::Mat3& r = pinhole.rotation;
  const float rotation[9] = {r.xx, r.xy, r.xz, r.yx, r.yy, r.yz, r.zx, r.zy, r.zz};
  std::copy_n(rotation, 9, camera.rotation);
  std::copy_n(&pinhole.translation.x, 3, camera.translation);
  return camera;
}

}  // namespace

TEST_CASE("the gradients of the camera and of the time of its view match finite differences") {
  for (unsigned seed : {1u, 2u, 3u}) {
    CameraProblem p{make_problem(seed), {}, {}};
    p.camera = camera_of(p.problem.camera);
    // Not the primitive whose projection is clamped, at limits that the gradient holds constant.
    p.problem.model.set.opacity_logit[0] = -20.0f;
    p.problem.settings.kernel = seed == 1 ? math::kDilated : math::kBandLimited;
    p.loss();
    const Problem& problem = p.problem;
    BlendBackwardScratch scratch;
    std::vector<SplatGradients> splats;
    PrimitiveGradients g;
    g.with_camera = true;
    blend_backward(problem.frame, problem.settings, problem.output, problem.weights, nullptr,
                   scratch, splats);
    project_backward(problem.model.set, problem.t, problem.camera, problem.settings, problem.frame,
                     splats, g);
    testing::check_gradient(p.problem, "time", {&p.problem.t, 1}, {&g.camera.time, 1}, 0.01f, 5e-3);
    const math::Vec3 r = g.camera.rotation, t = g.camera.translation;
    const float gradient[] = {r.x, r.y, r.z, t.x, t.y, t.z, g.camera.log_focal};
    const std::span<float> correction(p.correction);
    const std::span<const float> expected(gradient);
    testing::check_gradient(p, "turn", correction.first(3), expected.first(3), 2e-3f, 5e-3);
    testing::check_gradient(p, "shift", correction.subspan(3, 3), expected.subspan(3, 3), 4e-3f,
                            5e-3);
    testing::check_gradient(p, "focal", correction.subspan(encoder::kLogFocal, 1),
                            expected.subspan(encoder::kLogFocal, 1), 4e-3f, 5e-3);
  }
}

TEST_CASE(
    "SH coefficients above the degree in use have no gradient, and those below are unaffected") {
  Problem p = make_problem(4);
  for (int degree = 0; degree <= 3; ++degree) {
    p.settings.max_sh_degree = degree;
    p.loss();
    BlendBackwardScratch scratch;
    std::vector<SplatGradients> splats;
    PrimitiveGradients g;
    blend_backward(p.frame, p.settings, p.output, p.weights, nullptr, scratch, splats);
    project_backward(p.model.set, p.t, p.camera, p.settings, p.frame, splats, g);
    modulation_backward(p.model.set, p.frame, g);
    const std::size_t used = 3 * static_cast<std::size_t>((degree + 1) * (degree + 1));
    REQUIRE(g.sh.size() == used * p.model.set.size());
    std::vector<float> padded(p.model.set.sh.size(), 0.0f);
    for (std::size_t i = 0; i < p.model.set.size(); ++i)
      std::copy_n(&g.sh[i * used], used, &padded[i * 48]);
    check(p, "sh", p.model.set.sh, padded, 1e-2f);
    check(p, "position", p.model.set.position, g.position, 5e-3f);
  }
}

namespace {

void compare_with_reference() {
  const int sizes[][2] = {{160, 96}, {107, 61}, {5, 3}, {333, 17}};
  for (const auto& size : sizes) {
    const auto camera = testing::scene_camera(size[0], size[1]);
    const auto set = testing::random_scene(3000, camera, 31, {1, -2.8f, 0.8f});
    std::mt19937 random(7);
    std::normal_distribution<float> normal(0.0f, 1.0f);
    Image d_colour, error;
    d_colour.reshape(size[0], size[1], 3);
    error.reshape(size[0], size[1], 1);
    for (float& v : d_colour.data) v = normal(random);
    for (float& v : error.data) v = std::abs(normal(random));
    SplatFrame frame;
    RasterOutput output;
    RasterSettings settings;
    settings.background = {0.4f, 0.2f, 0.1f};
    std::vector<SplatGradients> gradients[2];
    BlendBackwardScratch scratch;
    for (bool scalar : {true, false}) {
      settings.scalar = scalar;
      render(set, 10.0f, camera, settings, frame, output);
      blend_backward(frame, settings, output, d_colour, &error, scratch, gradients[!scalar]);
    }
    REQUIRE(gradients[0].size() == gradients[1].size());
    constexpr std::size_t kFloats = sizeof(SplatGradients) / sizeof(float);
    for (std::size_t f = 0; f < kFloats; ++f) {
      double difference = 0, square = 0;
      for (std::size_t s = 0; s < gradients[0].size(); ++s) {
        const double a = reinterpret_cast<const float*>(&gradients[0][s])[f];
        const double b = reinterpret_cast<const float*>(&gradients[1][s])[f];
        difference += (a - b) * (a - b);
        square += a * a;
      }
      INFO(size[0] << " x " << size[1] << " on " << vector_target() << ", field " << f);
      CHECK(std::sqrt(difference) <= 2e-3 * std::sqrt(square));
    }
  }
}

}  // namespace

TEST_CASE("the backward pass of every vector target matches the scalar reference") {
  testing::for_each_vector_target(compare_with_reference);
}

TEST_CASE("one thread and two give bit-identical gradients") {
  const auto camera = testing::scene_camera(320, 180);
  const auto set = testing::random_scene(20000, camera, 41);
  for (bool scalar : {true, false}) {
    RasterSettings settings;
    settings.scalar = scalar;
    std::vector<SplatGradients> splats[2];
    PrimitiveGradients gradients[2];
    for (int threads : {1, 2}) {
      const testing::LoopThreads limit(threads);
      SplatFrame frame;
      RasterOutput output;
      BlendBackwardScratch scratch;
      render(set, 10.0f, camera, settings, frame, output);
      auto& by_splat = splats[threads - 1];
      blend_backward(frame, settings, output, output.colour, &output.alpha, scratch, by_splat);
      project_backward(set, 10.0f, camera, settings, frame, by_splat, gradients[threads - 1]);
    }
    REQUIRE(splats[0].size() == splats[1].size());
    CHECK(std::memcmp(splats[0].data(), splats[1].data(),
                      splats[0].size() * sizeof(SplatGradients)) == 0);
    CHECK(gradients[0].position == gradients[1].position);
    CHECK(gradients[0].rotation == gradients[1].rotation);
    CHECK(gradients[0].sh == gradients[1].sh);
    CHECK(gradients[0].sigma == gradients[1].sigma);
  }
}
