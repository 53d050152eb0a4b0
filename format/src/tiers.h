// SPDX-License-Identifier: Apache-2.0
// The tiers of a scene: which primitives come first, for a reader that begins with less.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "segmenter.h"

namespace stgs {

inline constexpr std::size_t kLeastTier =
    512;  // primitives: fewer would cost more in tables than they gain

// What moments need of a scene's primitives, as their segments are alive.
struct Demand {
  std::vector<float> shares;  // of each primitive: of all moments
  double peak = 0;            // primitives at the fullest moment
};
// Of `count` primitives; `whole` has the segments of each part.
Demand measure_demand(std::span<const PartRange> parts,
                      std::span<const std::vector<SegmentMembers>> whole, double chunk_ticks,
                      std::size_t count);

// The share that each tier has, those of most importance first: of like size where so many `tiers`
// are asked for. 0 chooses: three, but where the fullest moment needs so `many` that a third would
// take long to come over a link the first tier is small, each further one has twice as many, and
// there are as many as that makes.
std::vector<double> tier_shares(int tiers, double many);

struct TierPlan {
  std::vector<float> bounds;  // the least importance in each tier of the scene but the last
  bool graded = false;        // chosen for moments of many: by what they need, not by the scene
};
TierPlan plan_tiers(std::span<const float> importance, const Demand& needed, int tiers);

// Members of a segment that a tier has.
struct Tier {
  int importance = 0;  // which of TierPlan
  std::vector<std::uint32_t> members;
};

// The members by tier, those of most importance first; a tier that would be small goes with the one
// before or after it. Where the plan is graded a small first tier does not take much with it, many
// that are all of later tiers of the scene begin with an eighth of them, and no segment begins with
// many more than a moment should.
std::vector<Tier> tiers_of(const std::vector<std::uint32_t>& members,
                           std::span<const float> importance, const TierPlan& plan);

}  // namespace stgs
