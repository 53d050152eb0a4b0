// SPDX-License-Identifier: Apache-2.0
// The quantised profile's choices: what step each attribute gets, and the integers (spec 8).
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/gaussian4d.h"
#include "stream.h"

namespace stgs {

// Exponents of the steps, 2^e of the attribute's unit; for sigma and radius the mantissa bits that
// are dropped.
struct Steps {
  int position = 0;      // scene units
  int displacement = 0;  // scene units over the lifespan
  int time = 0;          // ticks
  int lifespan_shift = 0;
  int log_scale = 0;
  int rotation = 0;
  int opacity = 0;  // of the logit
  int sh[4] = {0, 0, 0, 0};
};

class Quantiser {
 public:
  // Chooses the steps for a whole set; quality 0..100.
  Quantiser(const Gaussians4D& set, std::uint32_t frames, int quality);

  // The set with time, sigma, radius and opacity as a decoder will see them.
  Gaussians4D snap_lifespans(const Gaussians4D& set) const;
  // Integers of a segment's primitives, whose lifespans are snapped, in Morton order; `order` is
  // set to the indices in that order.
  std::vector<Integers> quantise(const Gaussians4D& part, std::vector<std::uint32_t>& order) const;
  // Largest step of a position, scene units.
  float position_step() const;
  const Steps& steps() const { return steps_; }

 private:
  Steps steps_;
  int coarsest_position_ = 0;  // exponent that the whole set's extent needs
  std::uint32_t frames_;
};

}  // namespace stgs
