// SPDX-License-Identifier: Apache-2.0
// A step of several ranks on CPUs. The SH gradient is basis times colour gradient, so a view's
// contribution to a primitive is some 24 numbers whatever the degree. Every rank gathers all
// contributions and sums them itself, in rank order; all states remain bit-identical without ever
// being sent.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend/backend.h"
#include "backend/cpu/adam_primitive.h"
#include "stgs/encoder/ranks.h"
#include "stgs/format/math/lang.h"

namespace stgs::encoder::cpu {

// Offsets of the numbers of a contribution. kSh is the gradient of the colour in the view.
struct ContributionLayout {
  explicit ContributionLayout(const TrainState& state);

  std::array<std::size_t, kAttributes> at{}, components{};
  std::size_t statistics = 0;  // gradient, abs_gradient, error
  std::size_t size = 0;
};

// The contributions of one rank's view.
struct ViewContribution {
  StepOutput output;
  ColourMap by_colour_map{};
  std::vector<std::uint32_t> ids;  // of the visible primitives
  std::vector<float> numbers;      // ids.size() x layout.size

  void resize(std::size_t primitives, const ContributionLayout& layout);
  // Sets the contribution of primitive ids[s]; `by_colour` is the kSh entry.
  void set(std::size_t s, const ContributionLayout& layout, const LearntGradients& gradients,
           math::Vec3 by_colour, const ViewStatistics& statistics);
};

// Gathers the contributions of all ranks, in rank order.
Result<std::vector<ViewContribution>> gather_contributions(Ranks& ranks,
                                                           const ContributionLayout& layout,
                                                           const ViewContribution& own);

// `rendered`: the state's set as rendered.
// Applies one Adam step with the mean gradient of the views to each primitive visible in any of
// them, and one per view to the colour maps. Gathers statistics as if each view had been a separate
// step.
void apply_contributions(TrainState& state, const Gaussians4D& rendered, const StepInput& input,
                         const std::vector<ViewContribution>& views);

}  // namespace stgs::encoder::cpu
