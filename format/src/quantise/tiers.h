// SPDX-License-Identifier: Apache-2.0
// Assignment of primitives to tiers by importance, so that a reader can begin with a few of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "quantise/segmenter.h"

namespace stgs {

// Primitives of the smallest tier. Tables would cost a smaller one more than it gains.
inline constexpr std::size_t kMinTierSize = 512;

// How often a scene's primitives are needed, given the segments that contain them.
struct Demand {
  std::vector<float> shares;  // of each primitive: the share of all times at which it is needed
  double peak = 0;            // greatest number of primitives needed at one time
};
// Measures the demand of `count` primitives. `segments`: by part.
Demand measure_demand(std::span<const PartRange> parts,
                      std::span<const std::vector<SegmentMembers>> segments, double chunk_ticks,
                      std::size_t count);

// Returns the share of each tier, most important first. If `tiers` > 0 they are equal. 0 chooses
// three equal tiers or, if a third of the `peak` number of primitives would take long to download,
// a small first tier followed by tiers that double in size, as many as fit.
std::vector<double> tier_shares(int tiers, double peak);

struct TierPlan {
  std::vector<float> bounds;  // lowest importance in each tier except the last
  bool graded = false;        // chosen by demand, not by the number of primitives
};
TierPlan plan_tiers(std::span<const float> importance, const Demand& demand, int tiers);

// The members of a segment in one tier.
struct Tier {
  int importance = 0;  // index of the tier in the plan
  std::vector<std::uint32_t> members;
};

// Splits the members of a segment into tiers, most important first. A tier that would be too small
// is merged with a neighbour. If the plan is graded:
// - a small first tier is not merged with a large second one
// - a large segment whose members are all in later tiers begins with an eighth of them
// - no segment begins with many more primitives than the first tier should have at one time
std::vector<Tier> tiers_of(const std::vector<std::uint32_t>& members,
                           std::span<const float> importance, const TierPlan& plan);

}  // namespace stgs
