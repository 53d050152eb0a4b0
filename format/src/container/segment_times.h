// SPDX-License-Identifier: Apache-2.0
// Lookup of the segments needed at a time, without visiting all segments of a long file.
#pragma once

#include <cstdint>
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
  struct Entry {
    double begin = 0, end = 0;
    bool needed_at_end = false;
    std::uint32_t segment = 0;
  };
  // Segments of similar length: those needed at a time begin shortly before it.
  struct Group {
    double longest = 0;
    std::vector<Entry> by_begin;
  };
  std::vector<Group> groups_;
  double frames_ = 0;
};

}  // namespace stgs
