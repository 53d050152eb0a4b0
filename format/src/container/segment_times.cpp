// SPDX-License-Identifier: Apache-2.0
#include "container/segment_times.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace stgs {

SegmentTimes::SegmentTimes(const std::vector<SegmentInfo>& segments, double frames)
    : frames_(frames) {
  // By the power of two of their length.
  const auto power_of = [](const SegmentInfo& segment) {
    return std::ilogb(segment.end_ticks - segment.begin_ticks);
  };
  std::map<int, std::size_t> counts;
  for (const SegmentInfo& segment : segments) {
    if (segment.is_needed()) ++counts[power_of(segment)];
  }
  std::map<int, Group> groups;
  for (const auto& [power, count] : counts) groups[power].by_begin.reserve(count);
  for (std::uint32_t i = 0; i < segments.size(); ++i) {
    const SegmentInfo& segment = segments[i];
    if (!segment.is_needed()) continue;
    const double length = segment.end_ticks - segment.begin_ticks;
    Group& group = groups[power_of(segment)];
    group.longest = std::max(group.longest, length);
    group.by_begin.push_back({segment.begin_ticks, segment.end_ticks, segment.needed_at_end, i});
  }
  for (auto& [power, group] : groups) {
    std::sort(group.by_begin.begin(), group.by_begin.end(),
              [](const Entry& a, const Entry& b) { return a.begin < b.begin; });
    groups_.push_back(std::move(group));
  }
}

std::vector<std::uint32_t> SegmentTimes::between(double t0, double t1) const {
  std::vector<std::uint32_t> out;
  if (!(t0 <= t1)) return out;
  const double first = std::clamp(t0, 0.0, frames_), last = std::clamp(t1, 0.0, frames_);
  for (const Group& group : groups_) {
    // Starts a little earlier: lengths are rounded differences.
    const double earliest = first - group.longest - 1;
    auto at =
        std::lower_bound(group.by_begin.begin(), group.by_begin.end(), earliest,
                         [](const Entry& entry, double begin) { return entry.begin < begin; });
    for (; at != group.by_begin.end() && at->begin <= last; ++at) {
      if (first < at->end || (first == at->end && at->needed_at_end)) out.push_back(at->segment);
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace stgs
