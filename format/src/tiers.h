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

// For each of `count` primitives the share of all moments at which a reader needs it, as its
// segment is alive; `whole` has the segments of each part. The sum: how many a moment needs, in the
// mean.
std::vector<float> needed_shares(std::span<const PartRange> parts,
                                 std::span<const std::vector<SegmentMembers>> whole,
                                 double chunk_ticks, std::size_t count);

// The share of a moment's primitives that each tier has, those of most importance first: of like
// size where so many `tiers` are asked for. 0 chooses: three, but where a third of a moment, which
// needs so many, would take long to come over a link the first tier is small, each further one has
// twice as many, and there are as many as that makes.
std::vector<double> tier_shares(int tiers, double needed);

// Where the tiers end, over the whole scene: the least importance in each but the last, of so many
// tiers, or as many as tier_shares chooses. What is `needed` tells what a moment has of each; where
// tiers are of like size, the scene has.
std::vector<float> tier_bounds(std::span<const float> importance, std::span<const float> needed,
                               int tiers);

// Members of a segment that a tier has.
struct Tier {
  int importance = 0;  // which of tier_bounds
  std::vector<std::uint32_t> members;
};

// The members by tier, those of most importance first; a tier that would be small goes with the one
// before or after it, unless a small first one would bring much with it. Many that are all of later
// tiers of the scene begin with their eighth.
std::vector<Tier> tiers_of(const std::vector<std::uint32_t>& members,
                           std::span<const float> importance, std::span<const float> bounds);

}  // namespace stgs
