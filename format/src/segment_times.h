// SPDX-License-Identifier: Apache-2.0
// Segments by when they are shown, so that those of a moment are found without looking at the
// others, of which a long file has thousands.
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

  // Numbers of the segments that are shown somewhere in [t0, t1], ascending. What reaches the end
  // of the timeline is shown there too (spec 5.4).
  std::vector<std::uint32_t> between(double t0, double t1) const;

 private:
  struct Entry {
    double begin = 0, end = 0;
    std::uint32_t segment = 0;
  };
  // Segments of about one length: those of a moment begin shortly before it.
  struct Group {
    double longest = 0;
    std::vector<Entry> by_begin;
  };
  std::vector<Group> groups_;
  double frames_ = 0;
};

}  // namespace stgs
