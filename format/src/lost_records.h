// SPDX-License-Identifier: Apache-2.0
// Counting what damage takes of a file.
#pragma once

#include <algorithm>
#include <vector>

#include "stgs/format/damage_report.h"

namespace stgs {

// Counts a record, of `bytes`, that cannot be read because of `reason`; it is shown at `moments`.
inline void count_lost(DamageReport& losses, const TickRange& moments, std::uint64_t bytes,
                       const Status& reason) {
  losses.bytes += bytes;
  if (losses.reason.ok()) losses.reason = reason;
  if (moments.begin < moments.end) losses.ranges.push_back(moments);
}

// Joins what overlaps or follows each other.
inline void join_moments(DamageReport& losses) {
  std::vector<TickRange>& moments = losses.ranges;
  std::sort(moments.begin(), moments.end(),
            [](const TickRange& a, const TickRange& b) { return a.begin < b.begin; });
  std::size_t kept = 0;
  for (const TickRange& next : moments) {
    if (kept > 0 && next.begin <= moments[kept - 1].end) {
      moments[kept - 1].end = std::max(moments[kept - 1].end, next.end);
    } else {
      moments[kept++] = next;
    }
  }
  moments.resize(kept);
}

}  // namespace stgs
