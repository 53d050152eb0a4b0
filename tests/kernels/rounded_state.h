// SPDX-License-Identifier: Apache-2.0
// Training states that are being rounded.
#pragma once

#include <cmath>

#include "train_scene.h"

namespace stgs::testing {

// Makes a state round to the steps of a quality, with random importances.
inline void begin_rounding(encoder::TrainState& state, double ticks, double quality) {
  encoder::CompactionState& compaction = state.compaction;
  std::mt19937 random(11);
  std::uniform_real_distribution<float> uniform(0.0f, 8.0f);
  compaction.importance.clear();
  for (std::size_t i = 0; i < state.size(); ++i)
    compaction.importance.push_back(std::exp2(uniform(random)));
  Quantisation quantisation = choose_quantisation(state.set, compaction.importance, ticks, quality);
  state.set = round_lifespans(state.set, quantisation, ticks);
  for (std::size_t i = 0; i < state.size(); ++i) {
    state.log_sigma[i] = std::log(state.set.sigma[i]);
    const float f = math::lifespan_modulation(state.set.sigma[i], state.set.radius[i]);
    for (int c = 0; c < 3; ++c) state.velocity[3 * i + c] = f * state.set.velocity[3 * i + c];
  }
  compaction.tier.clear();
  for (const float x : compaction.importance)
    compaction.tier.push_back(static_cast<std::uint8_t>(quantisation.tier_of(x)));
  compaction.rules = encoder::rounding_rules(quantisation, ticks, state.set, compaction.tier);
  compaction.quantisation = std::move(quantisation);
}

}  // namespace stgs::testing
