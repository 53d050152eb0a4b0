// SPDX-License-Identifier: Apache-2.0
// The parts of the paper's method that --ablate disables (its Table 2).
#pragma once

#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::encoder {

enum class Densification {
  kScored,  // the paper's
  // As in 3DGS and 4DGS, which clone and split primitives with large mean gradients, clone in place
  // with the opacity of the original, and reset opacities. N then stays fixed after growth,
  // primitives keep their order and none is replaced.
  kPlain,
  kRelocation,  // as in FreeTimeGS (train/relocation.h): N is fixed from the start
};

// Each flag is true for the method of the paper.
struct Ablation {
  // False: the coupled 4D Gaussian of 4DGS (encoder/math/coupled.h), which has neither r nor f.
  bool representation = true;
  bool lifespan = true;        // false: r stays 0, so that l(t) is a Gaussian
  bool modulation = true;      // false: f = 1
  bool initialisation = true;  // false: one long-lived, static point cloud, no dynamic points
  Densification densification = Densification::kScored;

  // Parses comma-separated names; "" disables nothing. kUsage lists the names, or reports a name
  // that has no effect next to another.
  static Result<Ablation> from_names(const std::string& names);
  // Returns the names of the parts that differ from the paper's, in a fixed order.
  std::vector<std::string> names() const;
};

}  // namespace stgs::encoder
