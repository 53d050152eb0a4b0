// SPDX-License-Identifier: Apache-2.0
// The methods of --method: the paper's, and the published ones that it is compared with.
#pragma once

#include <string>

#include "train/ablation.h"
#include "train/hyper_parameters.h"

namespace stgs::encoder {

enum class Method {
  kSharpTimeGs,
  kFreeTimeGs,  // Wang et al., CVPR 2025
  k4dgs,        // Yang et al., ICLR 2024
};

// Parses a name of method_names(). kUsage lists the names.
Result<Method> method_from_name(const std::string& name);

// Sets the hyper-parameters in which a method differs from a preset, which decides the length and
// the size of the run. Velocities and lifespans are converted for 30 frames per second. Three
// values are not the published ones, but chosen on held-out training cameras
// (tests/bench/results.csv): sigma_static and prune_opacity of FreeTimeGS, and
// initial_opacity_dynamic of 4DGS.
void apply_method(Method method, HyperParameters& parameters);

// Returns the parts of the paper's method that a method has.
Ablation ablation_of(Method method);

}  // namespace stgs::encoder
