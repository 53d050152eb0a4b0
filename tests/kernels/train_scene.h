// SPDX-License-Identifier: Apache-2.0
// Training states and steps of a random scene, for the tests and benchmarks of the training
// backends.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "backend/backend.h"
#include "raster_scene.h"
#include "stgs/format/math/lifespan.h"
#include "train/coupled_state.h"

namespace stgs::testing {

// A state of the set, with `cameras` colour maps that differ slightly from the identity.
inline encoder::TrainState train_state(Gaussians4D set, std::size_t cameras) {
  encoder::TrainState state;
  state.set = std::move(set);
  const std::size_t n = state.set.size();
  state.velocity.resize(3 * n);
  state.log_sigma.resize(n);
  state.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    state.log_sigma[i] = std::log(state.set.sigma[i]);
    const float f = math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]);
    for (int c = 0; c < 3; ++c) state.velocity[3 * i + c] = f * state.set.velocity[3 * i + c];
  }
  state.derive_all(true);
  std::mt19937 random(7);
  std::normal_distribution<float> normal(0.0f, 0.02f);
  state.colour.assign(cameras, encoder::kIdentityColour);
  for (encoder::ColourMap& map : state.colour) {
    for (float& x : map) x += normal(random);
  }
  state.colour_first.assign(cameras, {});
  state.colour_second.assign(cameras, {});
  state.colour_updates.assign(cameras, 0);
  return state;
}

// A smooth image with some noise.
inline encoder::Image8 random_ground_truth(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  encoder::Image8 image{width, height, 3, {}};
  image.data.resize(std::size_t{3} * width * height);
  const float phase = 6.0f * uniform(random);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const float wave = std::sin(0.05f * static_cast<float>(x + c * y) + phase);
        const float value = 0.45f + 0.35f * wave + 0.15f * uniform(random);
        image.data[(std::size_t{1} * y * width + x) * 3 + c] =
            static_cast<std::uint8_t>(255.0f * value);
      }
    }
  }
  return image;
}

// A step with every loss term on and the rates of the middle of a run. `ground_truth` outlives the
// step, and its address is the id of the image.
inline encoder::StepInput train_step(const math::PinholeCamera& camera,
                                     const encoder::Image8& ground_truth, float ticks,
                                     int sh_degree) {
  encoder::StepInput input;
  input.camera = camera;
  input.ticks = ticks;
  input.ground_truth =
      encoder::borrowed_image(ground_truth, reinterpret_cast<std::uintptr_t>(&ground_truth));
  input.background = {0.3f, 0.1f, 0.6f};
  input.drop_share = 0.1f;
  input.drop_random = encoder::Random(3, 7, encoder::RandomPurpose::kDrop);
  input.sh_degree = sh_degree;
  input.damping = {12.0f, 3e-4f, 0.02f};
  input.short_lived = {12.0f, 0.5f};
  input.second_stage = true;
  input.gather_statistics = true;
  input.rates = {1e-4f, 5e-3f, 1e-3f, 2e-2f, 1e-4f, 1e-2f, 1e-3f, 5e-3f, 1e-2f};
  input.rate_sh0 = 2.5e-3f;
  input.rate_colour = 1e-3f;
  input.weight_l1 = 0.8f;
  input.weight_ssim = 0.2f;
  input.weight_lifespan = 1e-3f;
  input.weight_opacity = 1e-2f;
  input.weight_scale = 1e-2f;
  return input;
}

// Whether two states have the same bits in everything that a step changes.
inline bool same_bits(const encoder::TrainState& a, const encoder::TrainState& b) {
  bool same = a.updates == b.updates && a.colour == b.colour && a.set.velocity == b.set.velocity &&
              a.set.sigma == b.set.sigma && a.statistics.error_max == b.statistics.error_max &&
              a.statistics.gradient_sum == b.statistics.gradient_sum;
  for (int k = 0; k < encoder::kAttributes; ++k) {
    same = same && a.values(k) == b.values(k) && a.moments[k].first == b.moments[k].first &&
           a.moments[k].second == b.moments[k].second;
  }
  return same;
}

// The set in the coupled form, perturbed away from isotropic, whose axes are arbitrary, as after
// some training. `tick`: time units per frame.
inline encoder::TrainState coupled_state(Gaussians4D set, std::size_t cameras, float tick) {
  for (std::size_t i = 0; i < set.size(); ++i) {
    std::fill_n(&set.log_scale[3 * i], 3, set.log_scale[3 * i]);
    std::fill_n(&set.rotation[4 * i], 4, 0.0f);
    set.rotation[4 * i] = 1.0f;
  }
  encoder::TrainState state = train_state(std::move(set), cameras);
  encoder::start_coupled(state, tick);
  std::mt19937 random(8);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  for (float& v : state.coupled.left) v += 0.05f * normal(random);
  for (float& v : state.coupled.right) v += 0.01f * normal(random);
  for (float& v : state.coupled.log_scale) v += 0.5f * normal(random);
  state.derive_all(false);
  return state;
}

}  // namespace stgs::testing
