// SPDX-License-Identifier: Apache-2.0
// Lookup of the segments needed at a time, without visiting all segments of a long file.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs {

class SegmentTimes {
 public:
  SegmentTimes() = default;
  // `frames` is the end of the timeline, ticks.
  SegmentTimes(const std::vector<SegmentInfo>& segments, double frames);

  // Returns the indices of the segments needed at some time in [t0, t1], ascending. Times outside
  // the timeline count as its nearest end.
  std::vector<std::uint32_t> between(double t0, double t1) const;

 private:
  // Segments that follow each other and are needed at the same times, such as tiers.
  struct Entry {
    double begin = 0, end = 0;
    std::uint32_t first = 0;
    std::uint16_t count = 0;
    bool needed_at_end = false;

    bool takes(const SegmentInfo& next) const {
      return begin == next.begin_ticks && end == next.end_ticks &&
             needed_at_end == next.needed_at_end && count < 0xFFFF;
    }
  };
  // Segments of similar length: those needed at a time begin shortly before it.
  struct Group {
    double longest = 0;
    std::vector<Entry> by_begin;
  };
  template <typename Of, typename Visit>
  static void for_each_entry(const std::vector<SegmentInfo>& segments, std::map<int, Of>& groups,
                             const Visit& visit);

  std::vector<Group> groups_;
  double frames_ = 0;
};

}  // namespace stgs
