// SPDX-License-Identifier: Apache-2.0
#include "tiers.h"

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <utility>

namespace stgs {
namespace {

constexpr int kFewTiers = 3;
constexpr double kRounding = 1e-3;  // primitives: sums of shares fall short of a whole one
// Of the first tier at a moment where there are many: some 700 kB, so that over 50 Mbit/s and 40 ms
// there is a picture after .3 s.
constexpr double kFirstPrimitives = 9 << 12;

// Of tiers that have these shares of the scene.
std::vector<float> bounds_of_scene(std::span<const float> importance,
                                   std::span<const double> shares) {
  std::vector<float> sorted(importance.begin(), importance.end()), bounds;
  double before = 0.0;
  for (std::size_t t = 0; t + 1 < shares.size(); ++t) {
    before += shares[t] * static_cast<double>(sorted.size());
    const auto n =
        std::min(static_cast<std::ptrdiff_t>(before + kRounding), std::ssize(sorted) - 1);
    std::nth_element(sorted.begin(), sorted.begin() + n, sorted.end(), std::greater<>());
    bounds.push_back(sorted[static_cast<std::size_t>(n)]);
  }
  return bounds;
}

// Of tiers that have these shares of what moments need, in the mean.
std::vector<float> bounds_of_moments(std::span<const float> importance,
                                     std::span<const float> needed,
                                     std::span<const double> shares) {
  std::vector<std::uint32_t> order(importance.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return importance[a] != importance[b] ? importance[a] > importance[b] : a < b;
  });
  const double all = std::accumulate(needed.begin(), needed.end(), 0.0);
  std::vector<float> bounds;
  double before = 0.0, passed = 0.0;
  std::size_t k = 0;
  for (std::size_t t = 0; t + 1 < shares.size(); ++t) {
    before += shares[t] * all;
    while (k + 1 < order.size() && passed + needed[order[k]] <= before + kRounding) {
      passed += needed[order[k++]];
    }
    bounds.push_back(importance[order[k]]);
  }
  return bounds;
}

// Whether two tiers that follow each other stay two. A first one of little is worth its record
// where much would come with it.
bool are_apart(std::size_t first, std::size_t second, bool graded) {
  if (second < kLeastTier) return false;
  return first >= kLeastTier || (graded && first >= kLeastTier / 8 && second >= 8 * kLeastTier);
}

// How many a segment is to begin with, in place of all of its first tier; 0: with all of it. What
// matters little in the scene may be all of a segment, and many may matter alike.
std::size_t fewer_of(const Tier& first) {
  const std::size_t n = first.members.size();
  constexpr auto kMany = static_cast<std::size_t>(kFirstPrimitives);
  if (n > 2 * kMany) return kMany;
  return first.importance > 0 && n >= 8 * kLeastTier ? n / 8 : 0;
}

// Takes so many of most importance out of a tier.
Tier take_first(Tier& tier, std::size_t count, std::span<const float> importance) {
  const auto n = static_cast<std::ptrdiff_t>(count);
  std::nth_element(tier.members.begin(), tier.members.begin() + n, tier.members.end(),
                   [&](std::uint32_t a, std::uint32_t b) {
                     return importance[a] != importance[b] ? importance[a] > importance[b] : a < b;
                   });
  Tier out{tier.importance, {tier.members.begin(), tier.members.begin() + n}};
  tier.members.erase(tier.members.begin(), tier.members.begin() + n);
  return out;
}

bool is_graded(int tiers, double many) {
  return tiers == 0 && many > kFewTiers * kFirstPrimitives;
}

}  // namespace

Demand measure_demand(std::span<const PartRange> parts,
                      std::span<const std::vector<SegmentMembers>> whole, double chunk_ticks,
                      std::size_t count) {
  Demand out{std::vector<float>(count, 0.0f)};
  std::map<double, double> changes;  // primitives that come, less those that go, by moment
  const double ticks = ticks_of(parts);
  for (std::size_t p = 0; p < parts.size(); ++p) {
    for (const SegmentMembers& segment : whole[p]) {
      const Interval shown = shown_of(
          interval_of(segment.place.level, segment.place.slot, chunk_ticks, parts[p].length()),
          parts[p].interval, parts[p].cut);
      if (!(shown.begin < shown.end)) continue;
      const auto share = static_cast<float>((shown.end - shown.begin) / ticks);
      for (const std::uint32_t i : segment.members) out.shares[i] = share;
      const auto members = static_cast<double>(segment.members.size());
      changes[shown.begin] += members;
      changes[shown.end] -= members;
    }
  }
  double now = 0;
  for (const auto& [moment, change] : changes) out.most = std::max(out.most, now += change);
  return out;
}

std::vector<double> tier_shares(int tiers, double many) {
  if (!is_graded(tiers, many)) {
    const int count = tiers > 0 ? tiers : kFewTiers;
    return std::vector<double>(static_cast<std::size_t>(count), 1.0 / count);
  }
  std::vector<double> out;
  double left = 1.0;
  for (double share = kFirstPrimitives / many; left > 2 * share; share *= 2) {
    out.push_back(share);
    left -= share;
  }
  out.push_back(left);
  return out;
}

TierPlan plan_tiers(std::span<const float> importance, const Demand& needed, int tiers) {
  if (importance.empty()) return {};
  const std::vector<double> shares = tier_shares(tiers, needed.peak);
  if (!is_graded(tiers, needed.peak)) return {bounds_of_scene(importance, shares), false};
  return {bounds_of_moments(importance, needed.shares, shares), true};
}

std::vector<Tier> tiers_of(const std::vector<std::uint32_t>& members,
                           std::span<const float> importance, const TierPlan& plan) {
  const std::vector<float>& bounds = plan.bounds;
  std::vector<Tier> all(bounds.size() + 1);
  for (const std::uint32_t i : members) {
    std::size_t t = 0;
    while (t < bounds.size() && importance[i] < bounds[t]) ++t;
    all[t].members.push_back(i);
  }
  std::vector<Tier> out;
  for (std::size_t t = 0; t < all.size(); ++t) {
    all[t].importance = static_cast<int>(t);
    if (out.empty() || are_apart(out.back().members.size(), all[t].members.size(), plan.graded)) {
      out.push_back(std::move(all[t]));
      continue;
    }
    Tier& last = out.back();
    if (all[t].members.size() > last.members.size()) last.importance = static_cast<int>(t);
    last.members.insert(last.members.end(), all[t].members.begin(), all[t].members.end());
  }
  if (const std::size_t fewer = plan.graded ? fewer_of(out[0]) : 0; fewer > 0) {
    Tier first = take_first(out[0], fewer, importance);
    out.insert(out.begin(), std::move(first));
  }
  for (Tier& tier : out) std::sort(tier.members.begin(), tier.members.end());
  return out;
}

}  // namespace stgs
