// SPDX-License-Identifier: Apache-2.0
#include "stream/tier_peaks.h"

#include <algorithm>
#include <tuple>

namespace stgs::player {
namespace {

// A segment begins or ends to be needed: ticks, order at equal ticks, segment. The type is that of
// another sorted list (stream_timeline.cpp), since each sorting function adds to the WASM module.
using Change = std::tuple<double, int, std::uint32_t>;
// Segments that are still needed at their end leave after those that begin at this time.
constexpr int kLeavesBefore = 0, kBegins = 1, kLeavesAfter = 2;

std::vector<Change> changes_of(const std::vector<SegmentInfo>& segments) {
  std::vector<Change> changes;
  changes.reserve(2 * segments.size());
  for (std::uint32_t s = 0; s < segments.size(); ++s) {
    const SegmentInfo& segment = segments[s];
    if (!segment.is_needed()) continue;
    changes.emplace_back(segment.begin_ticks, kBegins, s);
    changes.emplace_back(segment.end_ticks, segment.needed_at_end ? kLeavesAfter : kLeavesBefore,
                         s);
  }
  std::sort(changes.begin(), changes.end());
  return changes;
}

}  // namespace

std::vector<std::uint64_t> tier_peaks(const std::vector<SegmentInfo>& segments, int tiers) {
  std::vector<std::uint64_t> peaks(static_cast<std::size_t>(tiers)), active(peaks.size());
  const std::vector<Change> changes = changes_of(segments);
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const auto [ticks, order, index] = changes[i];
    const SegmentInfo& segment = segments[index];
    if (order != kBegins) {
      active[segment.tier] -= segment.primitives;
      continue;
    }
    active[segment.tier] += segment.primitives;
    // Peaks are after all segments that begin at one time.
    if (i + 1 < changes.size() && std::get<0>(changes[i + 1]) == ticks &&
        std::get<1>(changes[i + 1]) == kBegins)
      continue;
    std::uint64_t sum = 0;
    for (std::size_t t = 0; t < peaks.size(); ++t) peaks[t] = std::max(peaks[t], sum += active[t]);
  }
  return peaks;
}

}  // namespace stgs::player
