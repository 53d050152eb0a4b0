// SPDX-License-Identifier: Apache-2.0
// The quantised profile: the step of each attribute, and the integers (spec 8).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "codec/stream.h"
#include "quantise/lifespans.h"
#include "quantise/segmenter.h"
#include "quantise/steps.h"
#include "stgs/format/gaussian4d.h"

namespace stgs {

// log2 of the steps for primitives of mean importance, in the unit of the attribute. Opacity has a
// single step in a file.
struct Steps {
  double position = 0;      // scene units
  double displacement = 0;  // scene units over the lifespan
  double log_scale = 0;
  double rotation = 0;
  double sh[4] = {0, 0, 0, 0};
  Step opacity;  // of the logit
};

// The steps of primitives that share a layout, and the origin of their positions.
struct GroupSteps {
  LifespanSteps lifespan;
  Step position, displacement, log_scale, rotation;
  Step sh[4];
  float origin[3] = {0, 0, 0};
};

class Quantiser {
 public:
  // Chooses the steps for a complete set, whose times count from the beginnings of parts that last
  // at most `longest_part` ticks.
  // - `importance` (N): Scene::importance or, with `by_size`, importance_by_size() of the set
  // - `quality`: 0..100
  // - `max_error`: greatest displacement of a primitive while it is visible, scene units; 0: given
  //   by the quality. Guaranteed if 21 bits suffice for the extent of a layout's positions.
  Quantiser(const Gaussians4D& set, std::span<const float> importance, bool by_size,
            double longest_part, double quality, double max_error);

  // Returns the set with time, sigma, radius and opacity as reconstructed by a decoder
  // (lifespans.h).
  Gaussians4D snap_lifespans(const Gaussians4D& set, std::span<const PartRange> parts) const;
  // Returns 0 for a primitive near the middle of the set that does not move far: its values fit the
  // steps of the quality. Otherwise returns 1 plus the number of factors of 16 by which it lies or
  // moves farther. Such outliers get layouts of their own, so that the others keep their steps.
  int distance_of(const Gaussians4D& set, std::size_t i) const;
  // Chooses the steps of primitives of `set` that share a layout. `importance` is their mean; the
  // lower it is, the coarser the steps.
  GroupSteps steps_of(const Gaussians4D& set, const std::vector<std::uint32_t>& members,
                      double importance) const;
  // Returns the integers of a segment's primitives, whose lifespans are snapped, in Morton order.
  // `order` receives their indices in that order. The segment begins at `segment_begin`, in ticks
  // of its part and before cutting; the part lasts `part_ticks`.
  std::vector<Integers> quantise(const Gaussians4D& part, const GroupSteps& steps,
                                 double segment_begin, float part_ticks,
                                 std::vector<std::uint32_t>& order) const;
  // Returns the largest position step for a set whose lifespans are snapped, scene units.
  float position_step(const Gaussians4D& set) const;

 private:
  // Returns a step near 2^octaves that is at most this share of max_error_.
  Step bounded(double octaves, double share, int in_octave) const;
  // Returns the step of displacements of at most `farthest`, scene units.
  Step displacement_step(double octaves, double farthest) const;

  Steps steps_;
  std::optional<LifespanGrids> lifespans_;
  float longest_part_ = 0;  // ticks
  double max_error_ = 0;    // scene units; 0: no bound
  // Exponents of importance in the steps of all attributes but position, and of position.
  double power_ = 0, position_power_ = 0;
  double coarser_ = 0;             // octaves, given by the quality
  double importance_ = 0;          // mean over the set
  std::array<float, 3> middle_{};  // of the set, scene units
  // Limits beyond which a primitive is an outlier, scene units: of the distance from the middle,
  // and of the displacement over a lifespan.
  double near_distance_ = 0, near_displacement_ = 0;
};

// Estimates Scene::importance without views: opacity^2 times the covered area times the share of
// `ticks`, the total duration. Extremely large areas are clamped.
std::vector<float> importance_by_size(const Gaussians4D& set, double ticks);

}  // namespace stgs
