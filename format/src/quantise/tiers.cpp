// SPDX-License-Identifier: Apache-2.0
#include "quantise/tiers.h"

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <utility>

namespace stgs {
namespace {

constexpr int kDefaultTiers = 3;
constexpr double kRounding = 1e-3;  // primitives; tolerance for sums of shares
// Primitives of a small first tier needed at one time: about 700 kB, which gives an image after 0.3
// s over a link of 50 Mbit/s with a latency of 40 ms.
constexpr double kFirstPrimitives = 9 << 12;

// Returns the bounds of tiers with these shares of the scene's primitives.
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

// Returns the bounds of tiers with these shares of the mean demand.
std::vector<float> bounds_of_demand(std::span<const float> importance,
                                    std::span<const float> needed, std::span<const double> shares) {
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

// Returns whether two successive tiers stay separate. A small first tier is worth its record if the
// second one is large.
bool stay_separate(std::size_t first, std::size_t second, bool graded) {
  if (second < kMinTierSize) return false;
  return first >= kMinTierSize ||
         (graded && first >= kMinTierSize / 8 && second >= 8 * kMinTierSize);
}

// Returns the number of primitives to split off a segment's first tier; 0: do not split it. The
// first tier is too large if all members belong to later tiers of the scene, or many are equally
// important.
std::size_t split_size(const Tier& first) {
  const std::size_t n = first.members.size();
  constexpr auto kMany = static_cast<std::size_t>(kFirstPrimitives);
  if (n > 2 * kMany) return kMany;
  return first.importance > 0 && n >= 8 * kMinTierSize ? n / 8 : 0;
}

// Moves the `count` most important members out of a tier.
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

bool is_graded(int tiers, double peak) {
  return tiers == 0 && peak > kDefaultTiers * kFirstPrimitives;
}

}  // namespace

Demand measure_demand(std::span<const PartRange> parts,
                      std::span<const std::vector<SegmentMembers>> segments, double chunk_ticks,
                      std::size_t count) {
  Demand out{std::vector<float>(count, 0.0f)};
  std::map<double, double> changes;  // net number of primitives added, by time
  const double ticks = ticks_of(parts);
  for (std::size_t p = 0; p < parts.size(); ++p) {
    for (const SegmentMembers& segment : segments[p]) {
      const TickRange needed = needed_of(
          interval_of(segment.key.level, segment.key.slot, chunk_ticks, parts[p].length()),
          parts[p].interval, parts[p].cut);
      if (!(needed.begin < needed.end)) continue;
      const auto share = static_cast<float>((needed.end - needed.begin) / ticks);
      for (const std::uint32_t i : segment.members) out.shares[i] = share;
      const auto members = static_cast<double>(segment.members.size());
      changes[needed.begin] += members;
      changes[needed.end] -= members;
    }
  }
  double now = 0;
  for (const auto& [time, change] : changes) out.peak = std::max(out.peak, now += change);
  return out;
}

std::vector<double> tier_shares(int tiers, double peak) {
  if (!is_graded(tiers, peak)) {
    const int count = tiers > 0 ? tiers : kDefaultTiers;
    return std::vector<double>(static_cast<std::size_t>(count), 1.0 / count);
  }
  std::vector<double> out;
  double left = 1.0;
  for (double share = kFirstPrimitives / peak; left > 2 * share; share *= 2) {
    out.push_back(share);
    left -= share;
  }
  out.push_back(left);
  return out;
}

TierPlan plan_tiers(std::span<const float> importance, const Demand& demand, int tiers) {
  if (importance.empty()) return {};
  const std::vector<double> shares = tier_shares(tiers, demand.peak);
  if (!is_graded(tiers, demand.peak)) return {bounds_of_scene(importance, shares), false};
  return {bounds_of_demand(importance, demand.shares, shares), true};
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
    if (out.empty() ||
        stay_separate(out.back().members.size(), all[t].members.size(), plan.graded)) {
      out.push_back(std::move(all[t]));
      continue;
    }
    Tier& last = out.back();
    if (all[t].members.size() > last.members.size()) last.importance = static_cast<int>(t);
    last.members.insert(last.members.end(), all[t].members.begin(), all[t].members.end());
  }
  if (const std::size_t count = plan.graded ? split_size(out[0]) : 0; count > 0) {
    Tier first = take_first(out[0], count, importance);
    out.insert(out.begin(), std::move(first));
  }
  for (Tier& tier : out) std::sort(tier.members.begin(), tier.members.end());
  return out;
}

}  // namespace stgs
