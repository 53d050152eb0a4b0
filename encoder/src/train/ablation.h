// SPDX-License-Identifier: Apache-2.0
// The paper's ideas that --ablate takes away (its Table 2).
#pragma once

#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::encoder {

// True: as in the paper.
struct Ablation {
  // False: the coupled 4D Gaussian of 4DGS (encoder/math/coupled.h), which has neither r nor f.
  bool representation = true;
  bool lifespan = true;        // false: r stays 0, so that l(t) is a Gaussian
  bool modulation = true;      // false: f = 1
  bool initialisation = true;  // false: one long-lived, motionless cloud, no dynamic points
  // False: as 3DGS and 4DGS do it: clones and splits where the mean gradient is large, clones in
  // place with the opacity of their origin, opacity resets; then N and the primitives' order stay
  // and nothing is replaced. The losses are the same.
  bool densification = true;

  // Names with commas between; "" takes nothing away. The error (kUsage) lists the names, or says
  // which has no effect beside another.
  static Result<Ablation> from_names(const std::string& names);
  // Of what is taken away, in one order.
  std::vector<std::string> names() const;
};

}  // namespace stgs::encoder
