// SPDX-License-Identifier: Apache-2.0
// Compares the coupled representation of the ablation on the CUDA and CPU backends, by the measures
// of test_cuda_backend.cpp.
#include <algorithm>
#include <cstdio>
#include <random>
#include <span>

#include "cuda_backend_check.h"
#include "fixtures/synthetic_capture.h"
#include "stgs/encoder/train.h"
#include "train/coupled_state.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr int kWidth = 160, kHeight = 96;

TrainState coupled_state(std::size_t n) {
  Gaussians4D set = random_scene(n, scene_camera(kWidth, kHeight), 5, {.sh_degree = 2});
  return testing::coupled_state(std::move(set), 1, 1.0f / 30.0f);
}

StepInput coupled_step(const Image8& ground_truth) {
  StepInput input = train_step(scene_camera(kWidth, kHeight), ground_truth, 8.0f, 2);
  input.modulated = input.learn_radius = false;
  return input;
}

void reserve(TrainBackend& backend, const TrainState& state) {
  TrainPlan plan;
  plan.primitives = state.size();
  plan.sh_coefficients = state.set.sh_coefficients();
  plan.width = kWidth;
  plan.height = kHeight;
  plan.coupled = true;
  check(backend.reserve(plan));
}

void run_steps(TrainBackend& backend, TrainState& state, int count) {
  const Image8 ground_truth = random_ground_truth(kWidth, kHeight, 100);
  reserve(backend, state);
  check(backend.begin(state));
  for (int s = 0; s < count; ++s) check(backend.step(coupled_step(ground_truth)));
  check(backend.read().status());
  check(backend.synchronise());
}

void compare(const char* name, std::span<const float> a, std::span<const float> b,
             double tolerance) {
  const double d = difference(a, b);
  std::printf("  coupled %-14s %.2e\n", name, d);
  INFO(name);
  CHECK(d <= tolerance);
}

void compare_rendered(const TrainState& cpu, const TrainState& gpu, double tolerance) {
  compare("rendered scales", cpu.set.log_scale, gpu.set.log_scale, tolerance);
  compare("rendered rotation", cpu.set.rotation, gpu.set.rotation, 30 * tolerance);
  compare("rendered u", cpu.set.velocity, gpu.set.velocity, tolerance);
  compare("rendered sigma", cpu.set.sigma, gpu.set.sigma, tolerance);
  CHECK(gpu.velocity == gpu.set.velocity);
}

}  // namespace

TEST_CASE("a CUDA step in the coupled form has the gradients and primitives of the CPU") {
  TrainState cpu = coupled_state(3000), gpu = cpu;
  const auto reference = make_cpu_backend();
  run_steps(*reference, cpu, 1);
  run_steps(cuda_backend(), gpu, 1);
  for (int a = 0; a < kAttributes; ++a) {
    compare(kAttributeNames[a], cpu.moments[a].first, gpu.moments[a].first, 5e-3);
  }
  CHECK(gpu.set.radius == cpu.set.radius);
  compare_rendered(cpu, gpu, 1e-4);
}

TEST_CASE("densification in the coupled form makes the same decisions as on the CPU") {
  HyperParameters parameters = *preset_hyper_parameters("fast");
  parameters.max_primitives = 8000;
  for (const bool refining : {false, true}) {
    TrainState cpu = coupled_state(5000);
    std::mt19937 random(3);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    for (std::size_t i = 0; i < cpu.size(); ++i) {
      cpu.statistics.views[i] = 3;
      cpu.statistics.gradient_sum[i] = 1e-3f * uniform(random);
      cpu.statistics.abs_gradient_sum[i] = 2e-3f * uniform(random);
      cpu.statistics.error_max[i] = uniform(random);
      if (i % 17 == 3) cpu.set.opacity_logit[i] = -7.0f;
      if (i % 911 == 5) cpu.coupled.right[4 * i + 2] = NAN;
    }
    cpu.iteration = 700;
    TrainState gpu = cpu;
    const DensifyInput input{&parameters,
                             {2.0f, false, false, 11},
                             refining ? DensifyStep::kReplace : DensifyStep::kGrow,
                             false};
    INFO((refining ? "replace" : "grow"));
    densify_both(cpu, gpu, input);
    // replace() leaves non-finite primitives that it has no replacement for.
    if (refining) continue;
    for (int a : {kLogScale, kRotation, kOpacity, kVelocity, kLogSigma}) {
      compare(kAttributeNames[a], cpu.values(a), gpu.values(a), 1e-5);
    }
    compare("position", cpu.set.position, gpu.set.position, 1e-3);
    compare_rendered(cpu, gpu, 1e-4);
  }
}

TEST_CASE(
    "training in the coupled form on CUDA recovers a held-out view and resumes to the same bits") {
  const test::SyntheticCapture synthetic;
  TrainSettings settings;
  settings.backend = "cuda";
  settings.preset = "fast";
  settings.ablate = "representation";
  settings.iterations = 400;
  settings.max_primitives = 600;
  settings.overrides = {{"densify_interval", "20"}, {"sh_degree", "1"}};
  check_resumes(synthetic, settings, 22.0);
}
