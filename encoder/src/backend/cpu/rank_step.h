// SPDX-License-Identifier: Apache-2.0
// A step of several ranks on CPUs. The gradient of the harmonics is basis times colour gradient, so
// what a view gives for a primitive is some 24 numbers whatever the degree: a contribution. Every
// rank gathers all contributions and adds them up itself, in the order of the ranks; all states
// stay the same to the bit without ever being sent.
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

// Where the numbers of a contribution are. kSh stands for the gradient by the colour seen.
struct ContributionLayout {
  explicit ContributionLayout(const TrainState& state);

  std::array<std::size_t, kAttributes> at{}, components{};
  std::size_t statistics = 0;  // gradient, abs_gradient, error
  std::size_t size = 0;
};

// What one rank's view gives.
struct ViewContribution {
  StepOutput output;
  ColourMap by_colour_map{};
  std::vector<std::uint32_t> ids;  // of the primitives seen
  std::vector<float> numbers;      // ids.size() x layout.size

  void resize(std::size_t primitives, const ContributionLayout& layout);
  // Fills in primitive s of ids; `by_colour` as the layout says.
  void set(std::size_t s, const ContributionLayout& layout, const LearntGradients& gradients,
           math::Vec3 by_colour, const ViewStatistics& statistics);
};

// Those of all ranks, in their order.
Result<std::vector<ViewContribution>> gather_contributions(Ranks& ranks,
                                                           const ContributionLayout& layout,
                                                           const ViewContribution& own);

// One step of Adam with the mean gradient of the views, for each primitive that any has seen, and
// one of the colour maps for each view; statistics as if each view had been a step of its own.
void apply_contributions(TrainState& state, const StepInput& input,
                         const std::vector<ViewContribution>& views);

}  // namespace stgs::encoder::cpu
