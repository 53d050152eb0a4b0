// SPDX-License-Identifier: Apache-2.0
// Compares a step of several ranks with the plain mean of the gradients of single-rank steps.
// Gradients are read from Adam's first moments after one step from zero, which are 0.1 times the
// gradient.
#include <algorithm>

#include "catch.h"
#include "stgs/format/parallel.h"
#include "thread_ranks.h"
#include "train/coupled_state.h"
#include "train_scene.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::testing;

namespace {

constexpr int kWidth = 120, kHeight = 72, kCameras = 4;

struct Setting {
  int ranks, sh_degree;
  bool coupled, learn_radius;
};

TrainState initial_state(const Setting& setting) {
  SceneShape shape;
  shape.sh_degree = 3;
  Gaussians4D set = random_scene(700, scene_camera(kWidth, kHeight), 5, shape);
  if (setting.coupled) {
    for (std::size_t i = 0; i < set.size(); ++i) {
      std::fill_n(&set.log_scale[3 * i], 3, set.log_scale[3 * i]);
      std::fill_n(&set.rotation[4 * i], 4, 0.0f);
      set.rotation[4 * i] = 1.0f;
    }
  }
  TrainState state = train_state(std::move(set), kCameras);
  if (setting.coupled) start_coupled(state, 0.1f);
  return state;
}

// The step of each rank: views of different primitives at different times.
std::vector<StepInput> make_inputs(const Setting& setting,
                                   const std::vector<Image8>& ground_truths) {
  std::vector<StepInput> inputs;
  std::vector<BatchView> batch;
  for (int r = 0; r < setting.ranks; ++r) {
    math::PinholeCamera camera = scene_camera(kWidth, kHeight);
    camera.translation.x += 0.6f * static_cast<float>(r) - 0.4f;
    StepInput input = train_step(camera, ground_truths[r], 4.0f + 5.0f * static_cast<float>(r),
                                 setting.sh_degree);
    input.learn_radius = setting.learn_radius;
    input.modulated = !setting.coupled;
    input.gather_camera = true;
    // Two of three ranks share a camera.
    input.colour_index = static_cast<std::size_t>(r) % 2;
    batch.push_back({math::camera_centre(camera), input.ticks, input.colour_index});
    inputs.push_back(input);
  }
  for (StepInput& input : inputs) input.batch = batch;
  return inputs;
}

std::vector<Image8> make_ground_truths(int ranks) {
  std::vector<Image8> ground_truths;
  for (int r = 0; r < ranks; ++r)
    ground_truths.push_back(random_ground_truth(kWidth, kHeight, 40 + r));
  return ground_truths;
}

void run_steps(TrainBackend& backend, TrainState& state, const StepInput& input, int steps) {
  if (!backend.reserve({}).ok() || !backend.begin(state).ok()) return;
  for (int s = 0; s < steps && backend.step(input).ok(); ++s) {
  }
}

}  // namespace

TEST_CASE("a step of several ranks has the mean of their gradients") {
  const Setting setting =
      GENERATE(Setting{2, 3, false, true}, Setting{3, 1, false, false}, Setting{2, 0, true, true});
  CAPTURE(setting.ranks, setting.coupled);
  const TrainState start = initial_state(setting);
  const std::vector<Image8> ground_truths = make_ground_truths(setting.ranks);
  const std::vector<StepInput> inputs = make_inputs(setting, ground_truths);
  std::vector<TrainState> single(inputs.size(), start), joint(inputs.size(), start);
  std::vector<StepOutput> single_outputs, joint_outputs;
  for (std::size_t r = 0; r < inputs.size(); ++r) {
    const auto backend = make_cpu_backend();
    run_steps(*backend, single[r], inputs[r], 1);
    single_outputs.push_back(backend->read()->front());
  }
  on_ranks(setting.ranks, [&](Ranks& ranks) {
    const auto r = static_cast<std::size_t>(ranks.rank());
    const auto backend = make_cpu_backend();
    if (!backend->join(ranks).ok()) return;
    run_steps(*backend, joint[r], inputs[r], 1);
    if (r == 0) joint_outputs = *backend->read();
  });
  REQUIRE(joint_outputs.size() == inputs.size());
  for (std::size_t r = 0; r < inputs.size(); ++r) {
    CHECK(same_bits(joint[0], joint[r]));
    CHECK(joint_outputs[r].loss == single_outputs[r].loss);
    CHECK(joint_outputs[r].visible == single_outputs[r].visible);
    REQUIRE(joint_outputs[r].camera);
    CHECK(std::memcmp(&*joint_outputs[r].camera, &*single_outputs[r].camera,
                      sizeof(math::CameraGrad)) == 0);
    CHECK(joint_outputs[r].vignetting == single_outputs[r].vignetting);
    CHECK(joint_outputs[r].vignetting != 0);
  }
  const TrainState& found = joint[0];
  const auto views = static_cast<float>(inputs.size());
  for (int a = 0; a < kAttributes; ++a) {
    double square = 0, length = 0;
    for (std::size_t k = 0; k < found.moments[a].first.size(); ++k) {
      double expected = 0;
      for (const TrainState& state : single) expected += state.moments[a].first[k] / views;
      square += std::pow(found.moments[a].first[k] - expected, 2);
      length += expected * expected;
    }
    CAPTURE(a);
    CHECK((length > 0) == (a != kRadius || setting.learn_radius));
    CHECK(std::sqrt(square) <= 2e-6 * std::sqrt(length));
  }
  std::size_t visible_to_some = 0;
  for (std::size_t i = 0; i < start.size(); ++i) {
    std::uint32_t updates = 0, views_of_primitive = 0;
    float gradient = 0, error = 0;
    for (const TrainState& state : single) {
      updates = std::max(updates, state.updates[i]);
      views_of_primitive += state.statistics.views[i];
      gradient += state.statistics.gradient_sum[i];
      error = std::max(error, state.statistics.error_max[i]);
    }
    if (views_of_primitive > 0 && views_of_primitive < inputs.size()) ++visible_to_some;
    REQUIRE(found.updates[i] == updates);
    REQUIRE(found.statistics.views[i] == views_of_primitive);
    REQUIRE(found.statistics.gradient_sum[i] == Approx(gradient).epsilon(1e-6));
    REQUIRE(found.statistics.error_max[i] == error);
  }
  CHECK(visible_to_some > 20);
  // Colour maps take one step per view, in the order of the ranks.
  CHECK(found.colour_updates[0] == (inputs.size() + 1) / 2);
  CHECK(found.colour_updates[1] == inputs.size() / 2);
}

TEST_CASE("ranks keep identical states over many steps, and repeated runs have the same bits") {
  const Setting setting{2, 2, false, true};
  const std::vector<Image8> ground_truths = make_ground_truths(setting.ranks);
  const std::vector<StepInput> inputs = make_inputs(setting, ground_truths);
  const TrainState start = initial_state(setting);
  std::vector<TrainState> states(4, start);
  for (const std::size_t first : {0, 2}) {
    on_ranks(2, [&](Ranks& ranks) {
      const auto r = static_cast<std::size_t>(ranks.rank());
      const auto backend = make_cpu_backend();
      if (!backend->join(ranks).ok()) return;
      run_steps(*backend, states[first + r], inputs[r], 12);
    });
  }
  for (const TrainState& state : states) CHECK(same_bits(states[0], state));
  CHECK_FALSE(same_bits(states[0], start));
}
