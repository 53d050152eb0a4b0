// SPDX-License-Identifier: Apache-2.0
// Where primitives go: growth in the first third (AbsGS with the clones of "Revising
// Densification"), replacement by the velocity-lifespan-aware score after it (paper 3.2).
#pragma once

#include <cstdint>

#include "train/densify_rules.h"
#include "train/hyper_parameters.h"
#include "train/train_state.h"

namespace stgs::encoder {

struct DensifyCounts {
  std::size_t cloned = 0, split = 0, removed = 0, replaced = 0;
  std::size_t non_finite = 0;  // of the removed or replaced: with a value that is not a number
};

struct DensifyContext {
  float extent = 1;       // scene units
  bool modulated = true;  // false: f = 1
  bool plain = false;     // growth as in 3DGS: mean gradients alone, clones that are copies
  std::uint64_t seed = 0;
};

DensifyRules densify_rules(const HyperParameters& parameters, const DensifyContext& context);

// How many primitives may be added to the `present` ones in one step of growth.
std::size_t growth_room(const HyperParameters& parameters, const DensifyContext& context,
                        std::size_t present);
// How many of the `dead` may be replaced in one step of the second stage, `alive` ones being left.
std::size_t replacement_room(const HyperParameters& parameters, std::size_t alive,
                             std::size_t dead);

// First stage: clones what is small and pulled, splits what is large and pulled both ways, removes
// what is nearly transparent or too large. Resets the statistics. A plain step is bounded by
// max_primitives alone.
DensifyCounts grow(TrainState& state, const HyperParameters& parameters,
                   const DensifyContext& context);

// Second stage: what is nearly transparent becomes clones of those with the highest score; N stays.
// Resets the statistics.
DensifyCounts replace(TrainState& state, const HyperParameters& parameters,
                      const DensifyContext& context);

// The score s of every primitive (paper eq. 5), E scaled so that its 99th percentile is 1.
std::vector<float> densification_scores(const TrainState& state, const HyperParameters& parameters,
                                        bool modulated);

// Removes primitives with a value that is not finite; how many.
std::size_t remove_non_finite(TrainState& state);

// Caps every opacity at twice what is pruned, so that what is not needed dies (3DGS; first stage
// only).
void reset_opacity(TrainState& state, const DensifyRules& rules);

}  // namespace stgs::encoder
