// SPDX-License-Identifier: Apache-2.0
// Repeated and resumed work on the CUDA training backend gives the same bits.
#include "cuda_steps.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

TEST_CASE("repeated steps give the same bits, even if tile lists outgrow their allocation") {
  for (const StepCase& c : {kPlain, kCrowded}) {
    const std::vector<Image8> ground_truths = random_ground_truths(c, 4);
    TrainState first = initial_state(c), second = first;
    run_steps(cuda_backend(), first, c, 40, ground_truths);
    cuda::CudaBackend fresh;
    check(fresh.create());
    run_steps(fresh, second, c, 40, ground_truths);
    CHECK((fresh.retried_steps() > 0) == (c.primitives == kCrowded.primitives));
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    CHECK(same_bits(first, second));
  }
}

TEST_CASE("steps with L_n give the same bits and do not affect later steps without it") {
  const auto with_normal_loss = [](StepInput& input) { input.weight_normal = 0.05f; };
  for (const StepCase& c : {kPlain, kCrowded}) {
    INFO(c.primitives << " primitives, " << c.width << "x" << c.height);
    const std::vector<Image8> ground_truths = random_ground_truths(c, 4);
    TrainState first = initial_state(c), second = first, without = first, after = first;
    cuda::CudaBackend backends[2];
    for (cuda::CudaBackend& backend : backends) check(backend.create());
    run_steps(backends[0], first, c, 20, ground_truths, with_normal_loss);
    const std::vector<StepOutput> outputs =
        run_steps(backends[1], second, c, 20, ground_truths, with_normal_loss);
    CHECK(outputs.back().normal > 0.0);
    CHECK(same_bits(first, second));
    run_steps(cuda_backend(), without, c, 5, ground_truths);
    const std::vector<StepOutput> off = run_steps(backends[0], after, c, 5, ground_truths);
    CHECK(off.back().normal == 0.0);
    CHECK(same_bits(without, after));
    CHECK_FALSE(same_bits(without, second));
  }
}

TEST_CASE("training on CUDA recovers a held-out view, and resumes to the same bits") {
  const test::SyntheticCapture synthetic;
  TrainSettings settings;
  settings.backend = "cuda";
  settings.preset = "fast";
  settings.iterations = 600;
  settings.max_primitives = 600;
  settings.overrides = {{"densify_interval", "20"}, {"sh_degree", "1"}};
  check_resumes(synthetic, settings, 24.0);
}
