// SPDX-License-Identifier: Apache-2.0
// The steps to which the quantised profile rounds a scene. Packing chooses them; a scene that was
// trained with quantisation in the loop states those it was trained for.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "stgs/format/coded_segment.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// The steps of the primitives of a tier, in the units of the attributes.
struct TierSteps {
  Step position;      // scene units
  Step displacement;  // scene units over a lifespan (spec 8.6)
  Step log_scale, rotation;
  std::array<Step, 4> sh;  // by SH degree
  bool operator==(const TierSteps&) const = default;
};

// The rounding of lifespans, for all tiers. Steps are log2 of ticks for T, of units in the last
// place for sigma and r. The others are tolerances: a primitive that moves by less than `motion`
// (scene units) and changes its opacity by less than `opacity` (0..1) becomes constant; edges move
// by less than `edge` sigmas.
struct LifespanRounding {
  double time = 0, lifespan = 0;
  double motion = 0, opacity = 0, edge = 0;
  bool operator==(const LifespanRounding&) const = default;
};

struct Quantisation {
  double quality = 0;          // 0..100, for which the steps were chosen
  double max_error = 0;        // greatest displacement of a primitive, scene units; 0: no bound
  double longest_part = 0;     // ticks
  bool near_lossless = false;  // of Profile::kNearLossless: chosen for no quality
  LifespanRounding lifespans;
  Step opacity;  // of the logit
  // Primitives farther than near_distance from the middle, or that move by more than
  // near_displacement, get coarser steps (scene units).
  std::array<float, 3> middle{};
  double near_distance = 0, near_displacement = 0;
  // Tiers by importance: the lowest importance in each but the last, and their steps. Graded: they
  // double in size.
  std::vector<float> bounds;
  bool graded = false;
  std::vector<TierSteps> tiers;  // one more than `bounds`
  bool operator==(const Quantisation&) const = default;

  // Returns the tier of a primitive.
  int tier_of(float importance) const {
    int t = 0;
    while (t < static_cast<int>(bounds.size()) && importance < bounds[static_cast<std::size_t>(t)])
      ++t;
    return t;
  }
};

// Returns whether all numbers are in the ranges that choose_quantisation() and the writer choose
// from. Others could make packing slow or fail.
bool is_valid(const Quantisation& quantisation);

// Chooses the quantisation to train a set for: that of packing at this quality, but with coarser
// steps of SH above degree 0, whose errors training corrects. The set is one part of
// `ticks` ticks. `importance`: Scene::importance.
Quantisation choose_quantisation(const Gaussians4D& set, std::span<const float> importance,
                                 double ticks, double quality);

// Estimates Scene::importance without views: opacity^2 times the covered area times the share of
// `ticks`, the total duration. Extremely large areas are clamped.
std::vector<float> importance_by_size(const Gaussians4D& set, double ticks);

// Returns the set with time, sigma, radius and opacity as a decoder reconstructs them, and the
// positions moved to the new times. The set is one part of `ticks` ticks.
Gaussians4D round_lifespans(const Gaussians4D& set, const Quantisation& quantisation, double ticks);

}  // namespace stgs
