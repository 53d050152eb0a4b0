// SPDX-License-Identifier: Apache-2.0
// A step of several ranks against the steps of one, from which the mean gradient is summed up
// plainly. Gradients are read from Adam's first moments after one step from zero, which are 0.1
// times the gradient.
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

TrainState start_of(const Setting& setting) {
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

// The step that each rank takes: views that see different primitives, at different moments.
std::vector<StepInput> inputs_of(const Setting& setting, const std::vector<Image8>& truths) {
  std::vector<StepInput> inputs;
  std::vector<BatchView> batch;
  for (int r = 0; r < setting.ranks; ++r) {
    math::PinholeCamera camera = scene_camera(kWidth, kHeight);
    camera.translation.x += 0.6f * static_cast<float>(r) - 0.4f;
    StepInput input =
        train_step(camera, truths[r], 4.0f + 5.0f * static_cast<float>(r), setting.sh_degree);
    input.learn_radius = setting.learn_radius;
    input.modulated = !setting.coupled;
    // Two of three ranks share a camera.
    input.colour_index = static_cast<std::size_t>(r) % 2;
    batch.push_back({math::camera_centre(camera), input.ticks, input.colour_index});
    inputs.push_back(input);
  }
  for (StepInput& input : inputs) input.batch = batch;
  return inputs;
}

std::vector<Image8> truths_of(int ranks) {
  std::vector<Image8> truths;
  for (int r = 0; r < ranks; ++r) truths.push_back(random_truth(kWidth, kHeight, 40 + r));
  return truths;
}

void take(TrainBackend& backend, TrainState& state, const StepInput& input, int steps) {
  if (!backend.reserve({}).ok() || !backend.begin(state).ok()) return;
  for (int s = 0; s < steps && backend.step(input).ok(); ++s) {
  }
}

}  // namespace

TEST_CASE("a step of several ranks has the plain mean of their gradients") {
  const Setting setting =
      GENERATE(Setting{2, 3, false, true}, Setting{3, 1, false, false}, Setting{2, 0, true, true});
  CAPTURE(setting.ranks, setting.coupled);
  const TrainState start = start_of(setting);
  const std::vector<Image8> truths = truths_of(setting.ranks);
  const std::vector<StepInput> inputs = inputs_of(setting, truths);
  std::vector<TrainState> alone(inputs.size(), start), together(inputs.size(), start);
  std::vector<StepOutput> alone_gave, together_gave;
  for (std::size_t r = 0; r < inputs.size(); ++r) {
    const auto backend = make_cpu_backend();
    take(*backend, alone[r], inputs[r], 1);
    alone_gave.push_back(backend->read()->front());
  }
  on_ranks(setting.ranks, [&](Ranks& ranks) {
    const auto r = static_cast<std::size_t>(ranks.rank());
    const auto backend = make_cpu_backend();
    if (!backend->join(ranks).ok()) return;
    take(*backend, together[r], inputs[r], 1);
    if (r == 0) together_gave = *backend->read();
  });
  REQUIRE(together_gave.size() == inputs.size());
  for (std::size_t r = 0; r < inputs.size(); ++r) {
    CHECK(same_bits(together[0], together[r]));
    CHECK(together_gave[r].loss == alone_gave[r].loss);
    CHECK(together_gave[r].visible == alone_gave[r].visible);
  }
  const TrainState& found = together[0];
  const auto views = static_cast<float>(inputs.size());
  for (int a = 0; a < kAttributes; ++a) {
    double square = 0, length = 0;
    for (std::size_t k = 0; k < found.moments[a].first.size(); ++k) {
      double expected = 0;
      for (const TrainState& state : alone) expected += state.moments[a].first[k] / views;
      square += std::pow(found.moments[a].first[k] - expected, 2);
      length += expected * expected;
    }
    CAPTURE(a);
    CHECK((length > 0) == (a != kRadius || setting.learn_radius));
    CHECK(std::sqrt(square) <= 2e-6 * std::sqrt(length));
  }
  std::size_t seen_by_some = 0;
  for (std::size_t i = 0; i < start.size(); ++i) {
    std::uint32_t updates = 0, seen = 0;
    float gradient = 0, error = 0;
    for (const TrainState& state : alone) {
      updates = std::max(updates, state.updates[i]);
      seen += state.statistics.views[i];
      gradient += state.statistics.gradient_sum[i];
      error = std::max(error, state.statistics.error_max[i]);
    }
    if (seen > 0 && seen < inputs.size()) ++seen_by_some;
    REQUIRE(found.updates[i] == updates);
    REQUIRE(found.statistics.views[i] == seen);
    REQUIRE(found.statistics.gradient_sum[i] == Approx(gradient).epsilon(1e-6));
    REQUIRE(found.statistics.error_max[i] == error);
  }
  CHECK(seen_by_some > 20);
  // Colour maps have a step a view, in the order of the ranks.
  CHECK(found.colour_updates[0] == (inputs.size() + 1) / 2);
  CHECK(found.colour_updates[1] == inputs.size() / 2);
}

TEST_CASE("ranks keep the same state over many steps, and repeat it") {
  const Setting setting{2, 2, false, true};
  const std::vector<Image8> truths = truths_of(setting.ranks);
  const std::vector<StepInput> inputs = inputs_of(setting, truths);
  const TrainState start = start_of(setting);
  std::vector<TrainState> states(4, start);
  for (const std::size_t first : {0, 2}) {
    on_ranks(2, [&](Ranks& ranks) {
      const auto r = static_cast<std::size_t>(ranks.rank());
      const auto backend = make_cpu_backend();
      if (!backend->join(ranks).ok()) return;
      take(*backend, states[first + r], inputs[r], 12);
    });
  }
  for (const TrainState& state : states) CHECK(same_bits(states[0], state));
  CHECK_FALSE(same_bits(states[0], start));
}
