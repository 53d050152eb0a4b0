// SPDX-License-Identifier: Apache-2.0
// When to densify: a pure function of the progress of the training.
#pragma once

#include "train/ablation.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

struct DensifyPlan {
  bool grow = false;      // now
  bool replace = false;   // now
  bool relocate = false;  // now
  bool gather = false;    // the step at this progress gathers statistics
  // L_opacity is on (paper 3.4) and, with the paper's densification, N is frozen (paper 3.2).
  bool second_stage = false;
  int resets_due = 0;  // opacity resets due so far; valid if grow
};

// The minimum number of densification steps of a run, so that even a short one grows before its
// first stage, a third of it, is over.
inline constexpr int kMinDensifySteps = 6;

// Returns the largest densify_interval that a run of `iterations` may use.
constexpr int max_densify_interval(int iterations) {
  return (iterations - 1) / kMinDensifySteps + 1;
}

// Returns the plan at a progress in [0, 1]. `interval`: the iteration is a multiple of
// densify_interval.
DensifyPlan densify_plan(const HyperParameters& parameters, const Ablation& ablation,
                         double progress, bool interval);

}  // namespace stgs::encoder
