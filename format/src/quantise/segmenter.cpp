// SPDX-License-Identifier: Apache-2.0
#include "quantise/segmenter.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/format/parallel.h"

namespace stgs {
namespace {

// Returns the widening of a support that covers rounding in a renderer.
double slack(double time, double half) {
  return 1e-3 + 1e-6 * (std::abs(time) + half);
}

constexpr std::size_t kSample = 1 << 18;  // lifetimes sampled for choosing a chunk
// Overhead of a segment, in primitives: index row, record headers, tables and coder states.
constexpr double kSegmentCost = 40.0;
constexpr double kSeekWeight = 0.25;    // weight of the share of inactive bytes read by a seek
constexpr double kMaxChunkCount = 1e6;  // per timeline

struct PartLifetime {
  Lifetime lifetime;
  std::uint32_t part = 0;
};

// Returns the lifetimes of every nth primitive, except invisible ones.
std::vector<PartLifetime> sample_lifetimes(const Gaussians4D& set, std::span<const PartRange> parts,
                                           std::size_t stride) {
  std::vector<PartLifetime> out;
  for (std::uint32_t p = 0; p < parts.size(); ++p) {
    for (std::size_t i = parts[p].first; i < parts[p].last; i += stride) {
      const Lifetime lifetime = lifetime_of(set, i, parts[p].length());
      if (!lifetime.never) out.push_back({lifetime, p});
    }
  }
  return out;
}

// Returns the cost of a chunk as a share of the primitives.
double cost_of(double chunk, const std::vector<PartLifetime>& sample,
               std::span<const PartRange> parts, double stride) {
  double active = 0.0, read = 0.0;
  std::vector<std::uint64_t> keys;
  keys.reserve(sample.size());
  for (const PartLifetime& s : sample) {
    const double length = parts[s.part].length();
    const SegmentKey key = key_of(s.lifetime, chunk, length);
    const TickRange interval = interval_of(key.level, key.slot, chunk, length);
    active += s.lifetime.end - s.lifetime.begin;
    read += interval.end - interval.begin;
    keys.push_back(std::uint64_t{s.part} << 37 | std::uint64_t(key.level + 1) << 32 | key.slot);
  }
  std::sort(keys.begin(), keys.end());
  const auto segments = std::unique(keys.begin(), keys.end()) - keys.begin();
  return kSegmentCost * static_cast<double>(segments) /
             (stride * static_cast<double>(sample.size())) +
         kSeekWeight * (read / active - 1.0);
}

}  // namespace

Lifetime lifetime_of(const Gaussians4D& set, std::size_t i, double length, bool widened,
                     double origin) {
  const float opacity = math::opacity_of(set.opacity_logit[i]);
  const double half = math::support_half_width(opacity * 1.000001f, set.sigma[i], set.radius[i],
                                               math::kAlphaThreshold);
  if (half < 0.0) return {0, 0, true};
  const double time = origin + set.time[i], reach = half + (widened ? slack(time, half) : 0.0);
  const double begin = std::max(0.0, time - reach);
  const double end = std::min(length, time + reach);
  if (begin >= end) return {0, 0, true};
  return {begin, end, false};
}

SegmentKey key_of(const Lifetime& lifetime, double chunk_ticks, double length) {
  if (lifetime.never || lifetime.end - lifetime.begin > 0.5 * length) return {};
  for (int level = 0; std::ldexp(chunk_ticks, level) < length; ++level) {
    const double half = std::ldexp(chunk_ticks, level - 1);
    double slot = std::floor(lifetime.begin / half);
    if (slot > 0.0 && slot * half > lifetime.begin) slot -= 1.0;
    const TickRange interval =
        interval_of(level, static_cast<std::uint32_t>(slot), chunk_ticks, length);
    if (lifetime.end < interval.end || interval.end >= length) {
      return {static_cast<std::int16_t>(level), static_cast<std::uint32_t>(slot)};
    }
  }
  return {};
}

std::vector<SegmentMembers> segments_of(const Gaussians4D& set, const PartRange& part,
                                        double chunk_ticks, bool include_invisible) {
  // Sorted by beginning, longer ones first; persistent ones before all others.
  std::map<std::pair<double, int>, SegmentMembers> segments;
  for (std::uint32_t i = part.first; i < part.last; ++i) {
    const Lifetime lifetime = lifetime_of(set, i, part.length());
    if (lifetime.never && !include_invisible) continue;
    const SegmentKey key = key_of(lifetime, chunk_ticks, part.length());
    const double begin = key.level < 0 ? -1.0 : begin_of(key.level, key.slot, chunk_ticks);
    SegmentMembers& segment = segments[{begin, -key.level}];
    segment.key = key;
    segment.members.push_back(i);
  }
  std::vector<SegmentMembers> out;
  out.reserve(segments.size());
  for (auto& [key, segment] : segments) out.push_back(std::move(segment));
  return out;
}

double ticks_of(std::span<const PartRange> parts) {
  double sum = 0.0;
  for (const PartRange& part : parts) sum += part.length();
  return sum;
}

double choose_chunk(const Gaussians4D& set, std::span<const PartRange> parts) {
  const std::size_t stride = set.size() / kSample + 1;
  const std::vector<PartLifetime> sample = sample_lifetimes(set, parts, stride);
  double longest = 1.0;
  for (const PartRange& part : parts) longest = std::max(longest, part.length());
  const double min_chunk = std::max(ticks_of(parts) / kMaxChunkCount, 2.0 * longest / kMaxSlots);
  std::vector<double> chunks;
  for (double chunk = 1.0; chunks.empty() || chunks.back() < longest; chunk *= 2.0) {
    if (chunk >= min_chunk) chunks.push_back(chunk);
  }
  if (sample.empty()) return chunks.back();
  std::vector<double> costs(chunks.size());
  parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t i) {
    costs[i] = cost_of(chunks[i], sample, parts, static_cast<double>(stride));
  });
  std::size_t best = 0;
  for (std::size_t i = 1; i < chunks.size(); ++i) {
    if (costs[i] <= costs[best]) best = i;
  }
  return chunks[best];
}

}  // namespace stgs
