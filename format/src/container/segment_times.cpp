// SPDX-License-Identifier: Apache-2.0
#include "container/segment_times.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace stgs {

// Calls visit(groups[power], entry) for each entry; `power`: of two, of its length.
template <typename Of, typename Visit>
void SegmentTimes::for_each_entry(const std::vector<SegmentInfo>& segments,
                                  std::map<int, Of>& groups, const Visit& visit) {
  Of* group = nullptr;
  int last = 0;
  for (std::uint32_t i = 0; i < segments.size();) {
    const SegmentInfo& segment = segments[i];
    Entry entry{segment.begin_ticks, segment.end_ticks, i, 1, segment.needed_at_end};
    for (++i; i < segments.size() && entry.takes(segments[i]); ++i) ++entry.count;
    if (!segment.is_needed()) continue;
    const int power = std::ilogb(entry.end - entry.begin);
    // Segments that follow each other often have similar lengths.
    if (group == nullptr || power != last) group = &groups[power];
    last = power;
    visit(*group, entry);
  }
}

SegmentTimes::SegmentTimes(const std::vector<SegmentInfo>& segments, double frames)
    : frames_(frames) {
  std::map<int, std::size_t> counts;
  for_each_entry(segments, counts, [](std::size_t& count, const Entry&) { ++count; });
  std::map<int, Group> groups;
  for (const auto& [power, count] : counts) groups[power].by_begin.reserve(count);
  for_each_entry(segments, groups, [](Group& group, const Entry& entry) {
    group.longest = std::max(group.longest, entry.end - entry.begin);
    group.by_begin.push_back(entry);
  });
  const auto comes_before = [](const Entry& a, const Entry& b) { return a.begin < b.begin; };
  for (auto& [power, group] : groups) {
    std::vector<Entry>& list = group.by_begin;
    if (!std::is_sorted(list.begin(), list.end(), comes_before))
      std::sort(list.begin(), list.end(), comes_before);
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
      if (first > at->end || (first == at->end && !at->needed_at_end)) continue;
      for (std::uint32_t i = 0; i < at->count; ++i) out.push_back(at->first + i);
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace stgs
