// SPDX-License-Identifier: Apache-2.0
// Densification: growth in the first third of a run (AbsGS with the clones of "Revising
// Densification"), then replacement by the velocity-lifespan-aware score (paper 3.2).
#pragma once

#include <cstdint>

#include "train/densify_rules.h"
#include "train/hyper_parameters.h"
#include "train/train_state.h"

namespace stgs::encoder {

struct DensifyCounts {
  std::size_t cloned = 0, split = 0, removed = 0, replaced = 0;
  std::size_t non_finite = 0;  // of those removed or replaced: with a non-finite value
};

struct DensifyContext {
  float extent = 1;       // scene units
  bool modulated = true;  // false: f = 1
  bool plain = false;     // growth as in 3DGS: mean gradients only, clones are exact copies
  std::uint64_t seed = 0;
  FreeSpace free_space{};  // primitives in it are removed
  Vicinity vicinity{};
};

DensifyRules densify_rules(const HyperParameters& parameters, const DensifyContext& context);

// Returns max_primitives for those that are not fixed: the fixed ones take at most half of it, so
// that moving content has space however many there are.
std::size_t max_trained(const HyperParameters& parameters, std::size_t fixed);
// Returns how many primitives one growth step may add to the `present` ones, `fixed` of which are
// fixed.
std::size_t max_growth(const HyperParameters& parameters, const DensifyContext& context,
                       std::size_t present, std::size_t fixed);
// Returns how many of the `dead` primitives one step of the second stage may replace, with
// `surviving` ones left that are not fixed.
std::size_t max_replacements(const HyperParameters& parameters, std::size_t surviving,
                             std::size_t dead);
// Returns the rank of the error that counts as 1 in the score, among `n` ascending errors, of which
// those of the `fixed` primitives are 0: the 99th percentile of the others.
constexpr std::size_t unit_error_rank(std::size_t n, std::size_t fixed) {
  return n - 1 - (n - fixed) / 100;
}

// First stage. Removes primitives that are nearly transparent, too large or in free space; clones
// small ones with a large mean gradient, and splits large ones with a large absolute gradient.
// Resets the statistics. A plain step is bounded by max_primitives alone.
DensifyCounts grow(TrainState& state, const HyperParameters& parameters,
                   const DensifyContext& context);

// Second stage. Replaces the primitives that the first stage would remove with clones of those with
// the highest score; N does not change. Resets the statistics.
DensifyCounts replace(TrainState& state, const HyperParameters& parameters,
                      const DensifyContext& context);

// Lists the primitives that survive pruning, as all fixed ones do; counts those with non-finite
// values.
std::vector<std::uint32_t> list_survivors(const TrainState& state, const DensifyRules& rules,
                                          const FreeSpace& free_space, std::size_t& non_finite);

// Moves primitive i by a sample of its own Gaussian scaled by `factor`.
void move_by_sample(TrainState& state, std::size_t i, float factor, Random& random);

// Returns the score s of every primitive (paper eq. 5), with E scaled so that its 99th percentile
// is 1.
std::vector<float> densification_scores(const TrainState& state, const HyperParameters& parameters,
                                        bool modulated);

// Removes primitives with a non-finite value; returns their number.
std::size_t remove_non_finite(TrainState& state);

// Caps the opacities at twice the pruning threshold, so that unneeded primitives fade out (3DGS;
// first stage only).
void reset_opacity(TrainState& state, const DensifyRules& rules);

}  // namespace stgs::encoder
