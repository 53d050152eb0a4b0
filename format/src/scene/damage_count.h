// SPDX-License-Identifier: Apache-2.0
// Adding damaged records to a DamageReport.
#pragma once

#include <algorithm>
#include <vector>

#include "stgs/format/damage_report.h"

namespace stgs {

// Adds a record of `bytes` that is needed during `range` and cannot be read because of `reason`.
inline void count_damage(DamageReport& report, const TickRange& range, std::uint64_t bytes,
                         const Status& reason) {
  report.bytes += bytes;
  if (report.reason.ok()) report.reason = reason;
  if (range.begin < range.end) report.ranges.push_back(range);
}

// Merges ranges that overlap or touch each other.
inline void merge_ranges(DamageReport& report) {
  std::vector<TickRange>& ranges = report.ranges;
  std::sort(ranges.begin(), ranges.end(),
            [](const TickRange& a, const TickRange& b) { return a.begin < b.begin; });
  std::size_t count = 0;
  for (const TickRange& next : ranges) {
    if (count > 0 && next.begin <= ranges[count - 1].end) {
      ranges[count - 1].end = std::max(ranges[count - 1].end, next.end);
    } else {
      ranges[count++] = next;
    }
  }
  ranges.resize(count);
}

}  // namespace stgs
