// SPDX-License-Identifier: Apache-2.0
// When to densify: a pure function of how far the training is.
#pragma once

#include "train/ablation.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

struct DensifyPlan {
  bool grow = false;     // now
  bool replace = false;  // now
  bool gather = false;   // statistics are wanted in the step at this share
  // L_opacity is on (paper 3.4) and N is frozen (paper 3.2); the second not where the densification
  // is ablated.
  bool second_stage = false;
  int resets_due = 0;  // opacity resets so far, where grow
};

// How often a run densifies at least, however short it is: so it grows before the first stage, a
// third of it, is over.
inline constexpr int kLeastMoments = 6;

// The densify_interval of a run of so many iterations, at most.
constexpr int longest_interval(int iterations) {
  return (iterations - 1) / kLeastMoments + 1;
}

// `share` of the iterations are done, [0, 1]; `interval` where the iteration is one of every
// densify_interval.
DensifyPlan densify_plan(const HyperParameters& parameters, const Ablation& ablation, double share,
                         bool interval);

}  // namespace stgs::encoder
