// SPDX-License-Identifier: Apache-2.0
#include "scene/tier_segments.h"

#include <algorithm>
#include <map>

#include "quantise/tiers.h"

namespace stgs {
namespace {

// Values of TierSegment::kind besides levels; outliers have kNear - Quantiser::distance_of().
constexpr int kConstant = -2, kNear = -2;

// Returns whether a primitive is static and equally visible throughout the interval; see
// Quantiser::snap_lifespans().
bool is_constant(const Gaussians4D& set, std::uint32_t i, const TickRange& interval) {
  const float* u = set.velocity.data() + 3 * std::size_t{i};
  return u[0] == 0.0f && u[1] == 0.0f && u[2] == 0.0f && set.sigma[i] == 1.0f &&
         2.0 * set.radius[i] >= interval.end - interval.begin;
}

// Moves outliers, which would make the steps of the others coarser, from a tier to segments of
// their own.
std::vector<TierSegment> take_far_segments(SegmentKey key, const Encoding& encoding, Tier& tier) {
  std::map<int, std::vector<std::uint32_t>> by_distance;
  for (const std::uint32_t i : tier.members) {
    by_distance[encoding.quantiser->distance_of(*encoding.set, i)].push_back(i);
  }
  tier.members = std::move(by_distance[0]);
  by_distance.erase(0);
  std::vector<TierSegment> out;
  out.reserve(by_distance.size());
  for (auto& [distance, members] : by_distance) {
    out.push_back({{key, std::move(members)}, tier.importance, kNear - distance});
  }
  return out;
}

// Splits a tier into segments. Constant primitives, if there are many and they are not stored as
// floats, get a segment of their own, so that their lifespans are a single symbol. Outliers come
// last.
std::vector<TierSegment> tier_segments_of(SegmentKey key, Tier tier, const Encoding& encoding,
                                          const TickRange& interval) {
  if (encoding.quantiser == nullptr) {
    return {{{key, std::move(tier.members)}, tier.importance, key.level}};
  }
  std::vector<TierSegment> far = take_far_segments(key, encoding, tier);
  TierSegment constant{{key, {}}, tier.importance, kConstant};
  TierSegment other{{key, {}}, tier.importance, key.level};
  for (const std::uint32_t i : tier.members) {
    const bool fixed = is_constant(*encoding.set, i, interval);
    (fixed ? constant : other).segment.members.push_back(i);
  }
  std::vector<TierSegment> out;
  if (constant.segment.members.size() >= kMinTierSize &&
      other.segment.members.size() >= kMinTierSize) {
    out = {std::move(constant), std::move(other)};
  } else if (!tier.members.empty()) {
    out = {{{key, std::move(tier.members)}, tier.importance, key.level}};
  }
  for (TierSegment& segment : far) out.push_back(std::move(segment));
  return out;
}

}  // namespace

std::vector<TierSegment> plan_segments(const Encoding& encoding,
                                       const std::vector<PartRange>& parts, Body& body) {
  std::vector<TierSegment> segments;
  for (std::uint32_t p = 0; p < parts.size(); ++p) {
    for (const SegmentMembers& segment : encoding.segments[p]) {
      int tier = 0;
      for (Tier& members : tiers_of(segment.members, encoding.importance, encoding.tiers)) {
        for (TierSegment& split :
             tier_segments_of(segment.key, std::move(members), encoding, parts[p].interval)) {
          SegmentEntry entry;
          entry.part = p;
          entry.base.level = split.segment.key.level;
          entry.base.slot = split.segment.key.slot;
          entry.base.layer = layer_of(Content::kPrimitives, tier++);
          entry.base.primitives = static_cast<std::uint32_t>(split.segment.members.size());
          body.index.segments.push_back(entry);
          segments.push_back(std::move(split));
        }
      }
    }
    const TickRange& all = parts[p].interval;
    body.parts.push_back({p, all.begin, all.end,
                          parts[p].cut.value_or(TickRange{std::max(all.begin, 0.0), all.end}),
                          encoding.chunk_ticks});
  }
  return segments;
}

}  // namespace stgs
