// SPDX-License-Identifier: Apache-2.0
// The lifespans of the quantised profile: what a decoder will see of T, sigma and r
// (spec 8.3, 8.4).
#pragma once

#include <cstdint>
#include <vector>

#include "container.h"
#include "steps.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// Steps of T, ticks, and of sigma and r + 1, units in the last place.
struct LifespanSteps {
  Step time, sigma, radius;
};

// What hardly changes and hardly moves is taken for constant; what does change, does so when it
// did.
struct LifespanBounds {
  double still = 0;  // scene units that a constant may move over its part
  double even = 0;   // that its opacity may be off, 0..1
  double edge = 0;   // sigmas that T - r and T + r may be off, or a step of T where that is more
};

// A flat top, and one that is seen alike within a part of so many ticks but has its T in it, or no
// radius.
struct FlatTop {
  double time = 0, radius = 0;  // ticks
};
FlatTop brought_in(FlatTop top, double length);

// Of one primitive.
struct Lifespan {
  double time = 0;  // ticks
  float sigma = 0, radius = 0;
  float opacity = 0;  // 0..1

  double visibility(double t) const;
  // Ticks beyond r in which it is drawn; negative where it never is.
  double fade() const;
};

// Grids of a whole file, as coarse as its quality has them, and the halves of their steps for what
// needs them: lifespans with hard edges are seen at the same frames as before, long ones with soft
// edges begin and end when they did, and nothing that was seen is lost.
class LifespanGrids {
 public:
  // T counts from the beginning of a part, which lasts `longest_part` ticks at most. `time` ticks
  // and `lifespan` units in the last place are log2 of the steps.
  LifespanGrids(double longest_part, double time, double lifespan, Step opacity,
                LifespanBounds bounds);

  // Lifespan and opacity of primitive i, which is drawn within `interval` of the timeline, and
  // where it is at its new T. What is never seen stays as it is.
  void snap(const Interval& interval, std::size_t i, Gaussians4D& set) const;
  // The coarsest steps that these primitives, snapped, are multiples of.
  LifespanSteps steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members) const;

 private:
  // T and r on the coarsest grids that do for a lifespan of this part; the others are on theirs.
  Lifespan rounded(const Lifespan& was, Lifespan life, const Interval& interval) const;

  Step time_, lifespan_, opacity_;
  LifespanBounds bounds_;
  double reach_ = 0;     // ticks: no |T| is greater
  int finest_time_ = 0;  // halvings of steps with which all within reach still has its number
};

}  // namespace stgs
