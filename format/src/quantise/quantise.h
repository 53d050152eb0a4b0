// SPDX-License-Identifier: Apache-2.0
// The quantised profile: the step of each attribute, and the integers (spec 8).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "codec/stream.h"
#include "quantise/lifespans.h"
#include "quantise/segmenter.h"
#include "quantise/steps.h"
#include "stgs/format/quantisation.h"

namespace stgs {

// The steps of primitives that share a layout, and the origin of their positions.
struct GroupSteps {
  LifespanSteps lifespan;
  Step position, displacement, log_scale, rotation;
  Step sh[4];
  float origin[3] = {0, 0, 0};
};

// Converts primitives to integers.
class Quantiser {
 public:
  explicit Quantiser(const Quantisation& rules);

  // Returns the set with time, sigma, radius and opacity as reconstructed by a decoder
  // (lifespans.h). `simplify`: false for a set whose lifespans are snapped already.
  Gaussians4D snap_lifespans(const Gaussians4D& set, std::span<const PartRange> parts,
                             bool simplify = true) const;
  // Returns 0 for a primitive near the middle of the set that does not move far: its values fit the
  // steps of its tier. Otherwise returns 1 plus the number of factors of 16 by which it lies or
  // moves farther. Such outliers get layouts of their own, so that the others keep their steps.
  int distance_of(const Gaussians4D& set, std::size_t i) const;
  // Returns the steps of members of a tier that share a layout: those of the tier, or coarser ones
  // if they are too far apart or move too far for these.
  GroupSteps steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                      int tier) const;
  // Returns the integers of a segment's primitives, whose lifespans are snapped, in Morton order.
  // `order` receives their indices in that order. The segment begins at `segment_begin`, in ticks
  // of its part and before cutting; `part_exponent`: of the length of the part.
  std::vector<Integers> quantise(const Gaussians4D& part, const GroupSteps& steps,
                                 double segment_begin, int part_exponent,
                                 std::vector<std::uint32_t>& order) const;
  // Returns the largest position step for a set whose lifespans are snapped, scene units.
  float position_step(const Gaussians4D& set) const;
  const Quantisation& rules() const { return rules_; }

 private:
  // Returns a step for displacements of at most `farthest`, scene units, no finer than `step`.
  Step displacement_step(Step step, double farthest) const;

  Quantisation rules_;
  LifespanGrids lifespans_;
};

}  // namespace stgs
