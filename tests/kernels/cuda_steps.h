// SPDX-License-Identifier: Apache-2.0
// Scenes and steps shared by the tests of the CUDA training backend.
#pragma once

#include <functional>
#include <vector>

#include "cuda_backend_check.h"
#include "train_scene.h"

namespace stgs::testing {

struct StepCase {
  std::size_t primitives;
  int width, height;
  int sh_degree;
  SceneShape shape;
};

// Runs `steps` training steps over five times and three cameras and returns the output of each.
// `change` edits the input of a step.
inline std::vector<encoder::StepOutput> run_steps(
    encoder::TrainBackend& backend, encoder::TrainState& state, const StepCase& c, int steps,
    const std::vector<encoder::Image8>& ground_truths,
    const std::function<void(encoder::StepInput&)>& change = {}) {
  check(backend.reserve({state.size(), state.set.sh_coefficients(), c.width, c.height}));
  check(backend.begin(state));
  for (int s = 0; s < steps; ++s) {
    math::PinholeCamera camera = scene_camera(c.width, c.height);
    camera.translation.x += 0.05f * static_cast<float>(s % 3);
    encoder::StepInput input = train_step(camera, ground_truths[s % ground_truths.size()],
                                          8.0f + static_cast<float>(s % 5), c.sh_degree);
    input.colour_index = static_cast<std::size_t>(s) % state.colour.size();
    if (change) change(input);
    check(backend.step(input));
  }
  Result<std::vector<encoder::StepOutput>> outputs = backend.read();
  check(outputs.status());
  check(backend.synchronise());
  return *outputs;
}

inline std::vector<encoder::Image8> random_ground_truths(const StepCase& c, int count) {
  std::vector<encoder::Image8> images;
  for (int k = 0; k < count; ++k) images.push_back(random_ground_truth(c.width, c.height, 100 + k));
  return images;
}

inline encoder::TrainState initial_state(const StepCase& c) {
  SceneShape shape = c.shape;
  shape.sh_degree = 3;
  return train_state(random_scene(c.primitives, scene_camera(c.width, c.height), 5, shape), 3);
}

inline const StepCase kPlain = {20000, 640, 360, 2, {}};
// Large splats: more tile instances than the first step has capacity for.
inline const StepCase kCrowded = {3000, 640, 360, 0, {3, -0.5f, 0.5f}};
inline const std::vector<StepCase> kCases = {
    {3000, 160, 96, 3, {}},
    {500, 101, 67, 1, {3, -2.5f, 0.8f}},
    {2000, 17, 33, 0, {}},
    {12000, 16, 16, 0, {}},  // one tile, with more entries than are sorted in shared memory
    {400, 333, 211, 2, {3, -1.0f, 0.7f}},
    kPlain,
    kCrowded,
};

}  // namespace stgs::testing
