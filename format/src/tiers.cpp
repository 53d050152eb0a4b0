// SPDX-License-Identifier: Apache-2.0
#include "tiers.h"

#include <algorithm>
#include <functional>
#include <utility>

namespace stgs {
namespace {

constexpr int kFewTiers = 3;
constexpr double kRounding = 1e-3;  // primitives: sums of shares fall short of a whole one
// Of the first tier at a moment where there are many: some 700 kB, so that over 50 Mbit/s and 40 ms
// there is a picture after .3 s.
constexpr double kFirstPrimitives = 5 << 13;

}  // namespace

double mean_needed(std::span<const PartRange> parts,
                   std::span<const std::vector<SegmentMembers>> whole, double chunk_ticks) {
  double sum = 0.0, ticks = 0.0;  // sum: primitives times ticks
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const double length = parts[p].length();
    ticks += length;
    for (const SegmentMembers& segment : whole[p]) {
      const Interval shown =
          interval_of(segment.place.level, segment.place.slot, chunk_ticks, length);
      sum += static_cast<double>(segment.members.size()) * (shown.end - shown.begin);
    }
  }
  return ticks > 0 ? sum / ticks : 0.0;
}

std::vector<double> tier_shares(int tiers, double needed) {
  if (tiers > 0 || needed <= kFewTiers * kFirstPrimitives) {
    const int count = tiers > 0 ? tiers : kFewTiers;
    return std::vector<double>(static_cast<std::size_t>(count), 1.0 / count);
  }
  std::vector<double> out;
  double left = 1.0;
  for (double share = kFirstPrimitives / needed; left > 2 * share; share *= 2) {
    out.push_back(share);
    left -= share;
  }
  out.push_back(left);
  return out;
}

std::vector<float> tier_bounds(std::span<const float> importance, std::span<const double> shares) {
  std::vector<float> sorted(importance.begin(), importance.end()), bounds;
  if (sorted.empty()) return bounds;
  double before = 0.0;
  for (std::size_t t = 0; t + 1 < shares.size(); ++t) {
    before += shares[t];
    const auto n =
        static_cast<std::ptrdiff_t>(before * static_cast<double>(sorted.size()) + kRounding);
    const auto at = sorted.begin() + std::min(n, std::ssize(sorted) - 1);
    std::nth_element(sorted.begin(), at, sorted.end(), std::greater<>());
    bounds.push_back(*at);
  }
  return bounds;
}

std::vector<Tier> tiers_of(const std::vector<std::uint32_t>& members,
                           std::span<const float> importance, std::span<const float> bounds) {
  std::vector<Tier> all(bounds.size() + 1);
  for (const std::uint32_t i : members) {
    std::size_t t = 0;
    while (t < bounds.size() && importance[i] < bounds[t]) ++t;
    all[t].members.push_back(i);
  }
  std::vector<Tier> out;
  for (std::size_t t = 0; t < all.size(); ++t) {
    all[t].importance = static_cast<int>(t);
    const bool small = all[t].members.size() < kLeastTier;
    if (out.empty() || (!small && out.back().members.size() >= kLeastTier)) {
      out.push_back(std::move(all[t]));
      continue;
    }
    Tier& last = out.back();
    if (all[t].members.size() > last.members.size()) last.importance = static_cast<int>(t);
    last.members.insert(last.members.end(), all[t].members.begin(), all[t].members.end());
  }
  for (Tier& tier : out) std::sort(tier.members.begin(), tier.members.end());
  return out;
}

}  // namespace stgs
