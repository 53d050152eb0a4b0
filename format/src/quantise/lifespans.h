// SPDX-License-Identifier: Apache-2.0
// Lifespans of the quantised profile: T, sigma and r as a decoder will reconstruct them (spec 8.3,
// 8.4).
#pragma once

#include <cstdint>
#include <vector>

#include "container/container.h"
#include "quantise/steps.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// Steps of T, in ticks, and of sigma and r + 1, in units in the last place.
struct LifespanSteps {
  Step time, sigma, radius;
};

// Tolerances. A primitive that changes and moves less than this becomes constant; the edges of the
// others keep their time within `edge`.
struct LifespanBounds {
  double motion = 0;     // of a constant primitive over its part, scene units
  double opacity = 0;    // error of a constant opacity, 0..1
  double logit = 0;      // error of a constant opacity, as its logit
  double edge = 0;       // error of T - r and T + r, in sigmas, or one step of T if that is more
  double hard_edge = 0;  // error of l at the first and last frame between hard edges
  float max_logit = 0;   // of an opacity and of its complement
};

// The flat top of a lifespan.
struct FlatTop {
  double time = 0, radius = 0;  // ticks
};
// Returns the flat top with the same visibility within a part of `length` ticks and its T inside
// the part, or with radius 0.
FlatTop normalised_top(FlatTop top, double length);

// The lifespan and opacity of one primitive.
struct Lifespan {
  double time = 0;  // ticks
  float sigma = 0, radius = 0;
  float opacity = 0;  // 0..1

  // Returns l(t).
  double visibility(double t) const;
  // Returns the ticks beyond r during which the primitive is visible; negative if it never is.
  double fade() const;
};

// The quantisation grids of a file, as coarse as its quality allows, and their halvings for
// primitives that need finer ones. Lifespans with hard edges stay visible at the same frames, long
// ones with soft edges keep the times of their edges, and no visible primitive becomes invisible.
class LifespanGrids {
 public:
  // T counts from the beginning of a part, which lasts `longest_part` ticks at most. `time` (ticks)
  // and `lifespan` (units in the last place) are log2 of the steps.
  LifespanGrids(double longest_part, double time, double lifespan, Step opacity,
                LifespanBounds bounds);

  // Quantises lifespan and opacity of primitive i, which is rendered within `interval` of the
  // timeline, and moves it to its position at the new T. Leaves invisible primitives unchanged.
  // `simplify`: lifespans that hardly differ from a simpler one become that.
  void snap(const TickRange& interval, std::size_t i, bool simplify, Gaussians4D& set) const;
  // Returns the coarsest steps of which these snapped primitives are multiples.
  LifespanSteps steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members) const;

 private:
  // Returns `life` with T and r on the coarsest grids that suffice for the lifespan `was` in this
  // part. The other members are already on their grids.
  Lifespan rounded(const Lifespan& was, Lifespan life, const TickRange& interval) const;

  Step time_, lifespan_, opacity_;
  LifespanBounds bounds_;
  double reach_ = 0;     // ticks; upper bound of |T|
  int finest_time_ = 0;  // number of halvings of time_ with which reach_ is still representable
};

}  // namespace stgs
