// SPDX-License-Identifier: Apache-2.0
// A training state of random numbers, for the trainer's tests.
#pragma once

#include <algorithm>
#include <cmath>

#include "train/random.h"
#include "train/train_state.h"

namespace stgs::testing {

inline encoder::TrainState random_train_state(std::size_t n, std::uint64_t seed) {
  using namespace encoder;
  TrainState state;
  state.set.sh_degree = 1;
  state.resize(n);
  Random random(seed, 0, RandomPurpose::kInitial);
  for (int a = 0; a < kAttributes; ++a) {
    for (float& v : state.values(a)) v = random.normal();
  }
  for (float& r : state.set.radius) r = std::abs(r);
  for (float& s : state.set.log_scale) s = 0.3f * s - 3.0f;
  state.derive_all(true);
  state.statistics.reset(n);
  state.colour.assign(2, kIdentityColour);
  state.colour_first.assign(2, ColourMap{});
  state.colour_second.assign(2, ColourMap{});
  state.colour_updates.assign(2, 0);
  return state;
}

}  // namespace stgs::testing
