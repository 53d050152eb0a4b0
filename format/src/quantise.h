// SPDX-License-Identifier: Apache-2.0
// The quantised profile's choices: what step each attribute gets, and the integers (spec 8).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "lifespans.h"
#include "segmenter.h"
#include "steps.h"
#include "stgs/format/gaussian4d.h"
#include "stream.h"

namespace stgs {

// log2 of the steps for primitives of mean importance, in the attribute's unit. Opacity has one
// step in a whole file.
struct Steps {
  double position = 0;      // scene units
  double displacement = 0;  // scene units over the lifespan
  double log_scale = 0;
  double rotation = 0;
  double sh[4] = {0, 0, 0, 0};
  Step opacity;  // of the logit
};

// The steps of primitives that share a layout, and where their positions count from.
struct GroupSteps {
  LifespanSteps lifespan;
  Step position, displacement, log_scale, rotation;
  Step sh[4];
  float origin[3] = {0, 0, 0};
};

class Quantiser {
 public:
  // Chooses the steps for a whole set, whose times count from the beginnings of parts that last
  // `longest_part` ticks at most; quality 0..100. `importance` (N): how much each primitive
  // adds to pictures, see Scene::importance, or what importance_by_size() makes of the set, then
  // `by_size`. `max_error`: how far, in scene units, a primitive may
  // come to lie from where it was, at any moment at which it is seen; 0: as far as quality has it.
  // It is kept where 21 bits for the extent of a layout's positions are enough.
  Quantiser(const Gaussians4D& set, std::span<const float> importance, bool by_size,
            double longest_part, double quality, double max_error);

  // The set with time, sigma, radius and opacity as a decoder will see them (lifespans.h).
  Gaussians4D snap_lifespans(const Gaussians4D& set, std::span<const PartRange> parts) const;
  // 0 for a primitive near the middle of the set that does not go far, whose numbers have the steps
  // that its quality asks for; else how many times 16 times farther one lies or goes: what is so
  // far out takes a layout of its own, so that the others keep their steps.
  int distance_of(const Gaussians4D& set, std::size_t i) const;
  // For those primitives of `set` that share a layout; `importance` is their mean: the less, the
  // coarser.
  GroupSteps steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                      double importance) const;
  // Integers of a segment's primitives, whose lifespans are snapped, in Morton order; `order` is
  // set to the indices in that order. The segment begins at `segment_begin`, ticks of its part,
  // before that, which lasts `part_ticks`, cuts it.
  std::vector<Integers> quantise(const Gaussians4D& part, const GroupSteps& steps,
                                 double segment_begin, float part_ticks,
                                 std::vector<std::uint32_t>& order) const;
  // Largest step of a position of a set whose lifespans are snapped, scene units.
  float position_step(const Gaussians4D& set) const;

 private:
  // Near 2^octaves, and not more than this share of the bound.
  Step bounded(double octaves, double share, int in_octave) const;
  // Of displacements of which none is greater than `farthest`, scene units.
  Step displacement_step(double octaves, double farthest) const;

  Steps steps_;
  std::optional<LifespanGrids> lifespans_;
  float longest_part_ = 0;  // ticks
  double max_error_ = 0;    // scene units; 0: no bound
  // Of importance in a step, and in that of a position.
  double power_ = 0, position_power_ = 0;
  double coarser_ = 0;              // octaves, of the quality
  double importance_ = 0;           // mean over the set
  std::array<float, 3> middle_{};   // of the set, scene units
  double near_ = 0, near_way_ = 0;  // scene units: from the middle, and over a lifespan
};

// What stands in for Scene::importance where nothing is known of any view: opacity^2 times the area
// that the primitive covers times the share of the time, of which all is `ticks`. What covers very
// much more than nearly all others counts less.
std::vector<float> importance_by_size(const Gaussians4D& set, double ticks);

}  // namespace stgs
