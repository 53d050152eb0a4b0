// SPDX-License-Identifier: Apache-2.0
// The coupled 4D Gaussian: conditioning against the textbook formula, gradients against finite
// differences, and the gradients of a training step.
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <filesystem>
#include <random>

#include "backend/backend.h"
#include "catch.h"
#include "fixtures/temporary_folder.h"
#include "raster_scene.h"
#include "stgs/format/raster.h"
#include "train/checkpoint.h"
#include "train/coupled_state.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

math::Coupled random_coupled(std::mt19937& random) {
  std::normal_distribution<float> normal(0.0f, 1.0f);
  const auto quat = [&] {
    return math::Quat{normal(random), normal(random), normal(random), normal(random)};
  };
  const math::Quat left = quat(), right = quat();
  return {left,
          right,
          std::exp(0.4f * normal(random)),
          {std::exp(0.4f * normal(random)), std::exp(0.4f * normal(random)),
           std::exp(0.4f * normal(random))}};
}

// The covariance over (t, x, y, z), in double precision.
Eigen::Matrix4d covariance_of(const math::Coupled& g) {
  const math::CoupledAxes a = math::coupled_axes(g);
  Eigen::Matrix4d m;
  int k = 0;
  for (const math::Quat& q : {a.t, a.x, a.y, a.z}) m.col(k++) << q.w, q.x, q.y, q.z;
  return m * m.transpose();
}

// Conditioning on a time by the rows of the axes: the reference for coupled_primitive and for the
// gradients.
math::Conditional conditional(const math::Coupled& g) {
  using namespace math;
  const CoupledRows r = coupled_rows(coupled_axes(g));
  const float variance = quat_dot(r.t, r.t);
  Conditional c;
  c.u = vec3_of(quat_dot(r.x, r.t) / variance, quat_dot(r.y, r.t) / variance,
                quat_dot(r.z, r.t) / variance);
  c.sigma = std::sqrt(2.0f * variance);
  const Quat x = quat_add(r.x, quat_scale(r.t, -c.u.x));
  const Quat y = quat_add(r.y, quat_scale(r.t, -c.u.y));
  const Quat z = quat_add(r.z, quat_scale(r.t, -c.u.z));
  c.covariance = {quat_dot(x, x), quat_dot(x, y), quat_dot(x, z),
                  quat_dot(y, y), quat_dot(y, z), quat_dot(z, z)};
  return c;
}

// Returns the k-th float of a struct of floats.
template <typename T>
float& entry(T& value, std::size_t k) {
  return reinterpret_cast<float*>(&value)[k];
}

constexpr std::size_t kParameters = sizeof(math::Coupled) / sizeof(float);
constexpr std::size_t kOutputs = sizeof(math::Conditional) / sizeof(float);

// A state in the coupled form, visible around t = 10.
TrainState coupled_state(const math::PinholeCamera& camera, std::size_t n) {
  TrainState state;
  state.set = testing::random_scene(n, camera, 3, {.sh_degree = 1, .log_scale_mean = -1.6f});
  for (std::size_t i = 0; i < n; ++i) {
    std::fill_n(&state.set.log_scale[3 * i], 3, state.set.log_scale[3 * i]);
    const float identity[4] = {1, 0, 0, 0};
    std::copy_n(identity, 4, &state.set.rotation[4 * i]);
  }
  const Gaussians4D set = state.set;
  state.resize(n);
  for (std::size_t i = 0; i < n; ++i) state.log_sigma[i] = std::log(set.sigma[i]);
  state.velocity = set.velocity;
  state.colour.assign(1, kIdentityColour);
  state.colour_first.assign(1, ColourMap{});
  state.colour_second.assign(1, ColourMap{});
  state.colour_updates.assign(1, 0);
  start_coupled(state, 1.0f / 30.0f);
  state.derive_all(false);
  return state;
}

}  // namespace

TEST_CASE("the coupled axes are a scaled rotation, and conditioning matches the textbook formula") {
  std::mt19937 random(1);
  for (int run = 0; run < 50; ++run) {
    const math::Coupled g = random_coupled(random);
    const Eigen::Matrix4d v = covariance_of(g);
    const double product = double(g.time) * g.scale.x * g.scale.y * g.scale.z;
    CHECK(v.determinant() == Approx(product * product).epsilon(1e-4));
    const math::Conditional c = conditional(g);
    const Eigen::Vector3d cross = v.block<3, 1>(1, 0);
    const Eigen::Matrix3d conditioned = v.block<3, 3>(1, 1) - cross * cross.transpose() / v(0, 0);
    CHECK(c.sigma == Approx(std::sqrt(2 * v(0, 0))).epsilon(1e-5));
    CHECK(c.u.x == Approx(cross[0] / v(0, 0)).epsilon(1e-4).margin(1e-5));
    CHECK(c.u.z == Approx(cross[2] / v(0, 0)).epsilon(1e-4).margin(1e-5));
    CHECK(c.covariance.xx == Approx(conditioned(0, 0)).epsilon(1e-4));
    CHECK(c.covariance.xy == Approx(conditioned(0, 1)).epsilon(1e-4).margin(1e-5));
    CHECK(c.covariance.yz == Approx(conditioned(1, 2)).epsilon(1e-4).margin(1e-5));
    CHECK(c.covariance.zz == Approx(conditioned(2, 2)).epsilon(1e-4));
  }
}

TEST_CASE("gradients of the coupled form match finite differences in every parameter") {
  std::mt19937 random(2);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  for (int run = 0; run < 20; ++run) {
    math::Coupled g = random_coupled(random);
    math::Conditional weights;
    for (std::size_t k = 0; k < kOutputs; ++k) entry(weights, k) = normal(random);
    const auto loss = [&](math::Coupled at) {
      math::Conditional c = conditional(at);
      double sum = 0;
      for (std::size_t k = 0; k < kOutputs; ++k) {
        sum += static_cast<double>(entry(weights, k)) * entry(c, k);
      }
      return sum;
    };
    math::Coupled gradient = math::coupled_conditional_grad(g, weights);
    for (std::size_t k = 0; k < kParameters; ++k) {
      const float step = 2e-3f;
      math::Coupled high = g, low = g;
      entry(high, k) += step;
      entry(low, k) -= step;
      const double expected = (loss(high) - loss(low)) / (2 * step);
      CAPTURE(run, k);
      CHECK(entry(gradient, k) == Approx(expected).epsilon(2e-2).margin(2e-2));
    }
  }
}

TEST_CASE("coupled_primitive has the covariance of the conditional") {
  std::mt19937 random(4);
  constexpr float kTick = 1.0f / 30.0f;
  for (int run = 0; run < 200; ++run) {
    math::Coupled g = random_coupled(random);
    // Includes flat primitives and needles.
    if (run % 2 == 1) g.scale.x *= 1e-3f;
    if (run % 3 == 1) g.scale.y *= 1e-2f;
    const math::Conditional c = conditional(g);
    const math::CoupledPrimitive primitive = math::coupled_primitive(g, kTick);
    CAPTURE(run);
    CHECK(primitive.sigma * kTick == Approx(c.sigma).epsilon(1e-5));
    CHECK(primitive.u.y == Approx(c.u.y * kTick).epsilon(1e-5).margin(1e-7));
    const math::Vec3 scale = {std::exp(primitive.log_scale.x), std::exp(primitive.log_scale.y),
                              std::exp(primitive.log_scale.z)};
    math::Sym3 found = math::covariance_of(primitive.rotation, scale), expected = c.covariance;
    const float trace = expected.xx + expected.yy + expected.zz;
    for (std::size_t k = 0; k < 6; ++k) {
      CHECK(entry(found, k) == Approx(entry(expected, k)).margin(4e-6f * trace));
    }
    // The shortest axis, for which the single-precision covariance is too inexact.
    const Eigen::Matrix4d v = covariance_of(g);
    const Eigen::Vector3d cross = v.block<3, 1>(1, 0);
    const Eigen::Matrix3d conditioned = v.block<3, 3>(1, 1) - cross * cross.transpose() / v(0, 0);
    const double min_eigenvalue =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(conditioned).eigenvalues()[0];
    const float min_scale = std::min({scale.x, scale.y, scale.z});
    CHECK(min_scale == Approx(std::sqrt(min_eigenvalue)).epsilon(1e-2));
  }
}

TEST_CASE("an isotropic primitive keeps its shape in the coupled form") {
  const math::PinholeCamera camera = testing::scene_camera(64, 48);
  Gaussians4D before =
      testing::random_scene(60, camera, 3, {.sh_degree = 1, .log_scale_mean = -1.6f});
  const TrainState state = coupled_state(camera, 60);
  for (std::size_t i = 0; i < 60; ++i) {
    CAPTURE(i);
    CHECK(state.set.sigma[i] == Approx(before.sigma[i]).epsilon(1e-3));
    CHECK(state.set.radius[i] == 0.0f);
    for (std::size_t c = 0; c < 3; ++c) {
      CHECK(state.set.velocity[3 * i + c] ==
            Approx(before.velocity[3 * i + c]).epsilon(1e-3).margin(1e-6));
      CHECK(state.set.log_scale[3 * i + c] == Approx(before.log_scale[3 * i]).margin(2e-3));
    }
  }
}

// Learning rates of 0 leave the state unchanged, and the first moments hold a tenth of the
// gradient.
TEST_CASE(
    "the gradients of a training step in the coupled form match finite differences of its loss") {
  const math::PinholeCamera camera = testing::scene_camera(40, 32);
  TrainState state = coupled_state(camera, 12);
  std::mt19937 random(5);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  // Perturbed away from isotropic, as after some training.
  for (int a : {kLogScale, kRotation, kVelocity}) {
    for (float& v : state.values(a)) v += 0.05f * normal(random);
  }
  for (float& v : state.coupled.log_scale) v += 0.3f * normal(random);
  for (float& v : state.set.opacity_logit) v = 1.0f + 0.1f * normal(random);
  state.derive_all(false);
  Image8 ground_truth;
  ground_truth.width = 40;
  ground_truth.height = 32;
  ground_truth.channels = 3;
  ground_truth.data.resize(40 * 32 * 3);
  for (auto& v : ground_truth.data) v = static_cast<std::uint8_t>(random() % 256);
  StepInput input;
  input.camera = camera;
  input.ticks = 10.3f;
  input.ground_truth = borrowed_image(ground_truth, 0);
  input.sh_degree = 1;
  input.modulated = false;
  input.learn_radius = false;
  input.weight_ssim = 1.0f;  // L1 has kinks
  input.weight_scale = 0.05f;
  input.weight_lifespan = 0.1f;
  const auto backend = make_cpu_backend();
  REQUIRE(backend->begin(state).ok());
  const auto loss = [&] {
    REQUIRE(backend->step(input).ok());
    return backend->read()->back().loss;
  };
  loss();
  const std::array<encoder::Moments, kAttributes> moments = state.moments;
  for (int a : {kLogScale, kRotation, kVelocity, kLogSigma, kPosition, kTime}) {
    const std::vector<float> tenth = moments[a].first;
    double dot = 0, own = 0, other = 0;
    for (std::size_t k = 0; k < tenth.size(); ++k) {
      float& value = state.values(a)[k];
      const float original = value, step = 1e-2f;  // above the noise of the sums
      value = original + step;
      state.derive_all(false);
      const double high = loss();
      value = original - step;
      state.derive_all(false);
      const double low = loss();
      value = original;
      state.derive_all(false);
      const double expected = (high - low) / (2 * step);
      dot += 10 * tenth[k] * expected;
      own += 100.0 * tenth[k] * tenth[k];
      other += expected * expected;
    }
    CAPTURE(a, own, other);
    REQUIRE(other > 0);
    CHECK(dot / std::sqrt(own * other) > 0.995);
    CHECK(std::sqrt(own / other) == Approx(1.0).margin(0.05));
  }
}

TEST_CASE("a checkpoint of the coupled form restores the rendered primitives bit for bit") {
  const TrainState state = coupled_state(testing::scene_camera(64, 48), 20);
  const testing::TemporaryFolder folder;
  const std::string path = folder / "coupled.ckpt";
  REQUIRE(write_checkpoint(path, state, {}).ok());
  const Result<Checkpoint> checkpoint = read_checkpoint(path);
  REQUIRE(checkpoint.ok());
  const TrainState* restored = &checkpoint->state;
  CHECK(restored->coupled.tick == state.coupled.tick);
  CHECK(restored->coupled.right == state.coupled.right);
  CHECK(restored->set.log_scale == state.set.log_scale);
  CHECK(restored->set.rotation == state.set.rotation);
  CHECK(restored->set.velocity == state.set.velocity);
  CHECK(restored->set.sigma == state.set.sigma);
}
