// SPDX-License-Identifier: Apache-2.0
// The lists that a reader offers its callers, derived from the head of a file.
#pragma once

#include <vector>

#include "container/container.h"
#include "container/segment_times.h"

namespace stgs {

struct ReaderLists {
  ReaderLists() = default;
  explicit ReaderLists(const FileHead& head);

  std::vector<SegmentInfo> segments;
  SegmentTimes times;
  std::vector<ScenePart> parts;
  double complete_ticks = 0;  // the time up to which nothing is missing
  double latest_begin = 0;    // of a part, ticks
};

}  // namespace stgs
