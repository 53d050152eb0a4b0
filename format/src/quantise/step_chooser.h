// SPDX-License-Identifier: Apache-2.0
// The choice of steps: by a quality, or so fine that a file is nearly lossless.
#pragma once

#include <span>

#include "quantise/tiers.h"
#include "stgs/format/quantisation.h"

namespace stgs {

// What steps are chosen for.
struct StepGoal {
  double quality = 0;  // 0..100
  // Greatest displacement of a primitive while it is visible, scene units; 0: given by the quality.
  // Guaranteed if kPositionBits suffice for the extent of a layout's positions.
  double max_error = 0;
  bool near_lossless = false;  // in place of a quality: steps that no render reveals, for all tiers
};

// Chooses the steps of a set, whose times count from the beginnings of parts that last at most
// `longest_part` ticks. `importance` (N): Scene::importance or, with `by_size`,
// importance_by_size() of the set.
class StepChooser {
 public:
  StepChooser(const Gaussians4D& set, std::span<const float> importance, bool by_size,
              double longest_part, const StepGoal& goal);

  // Returns everything but the tiers.
  Quantisation rules() const { return rules_; }
  // Returns the steps of primitives by their mean importance: the lower, the coarser.
  TierSteps steps_for(double importance) const;

 private:
  // log2 of the steps for primitives of mean importance, in the unit of the attribute.
  struct Octaves {
    double position = 0, displacement = 0, log_scale = 0, rotation = 0, sh[4] = {0, 0, 0, 0};
  };
  void choose_by_quality(const Gaussians4D& set, bool by_size);
  void choose_near_lossless(const Gaussians4D& set);
  void limit_outliers(const Gaussians4D& set);
  Step position_step(double octaves) const;
  Step displacement_step(double octaves) const;

  Quantisation rules_;
  Octaves octaves_;
  // Exponents of importance in the steps of all attributes but position, and of position.
  double power_ = 0, position_power_ = 0;
  double coarser_ = 0;     // octaves, given by the quality
  double importance_ = 0;  // mean over the set
};

// Sets the tiers of a quantisation and their steps. `importance`: of all primitives.
void set_tiers(const StepChooser& chooser, const TierPlan& plan, std::span<const float> importance,
               Quantisation& quantisation);

}  // namespace stgs
