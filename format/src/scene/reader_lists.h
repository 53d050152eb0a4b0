// SPDX-License-Identifier: Apache-2.0
// The lists that a reader offers its callers, derived from the head of a file.
#pragma once

#include <vector>

#include "container/container.h"
#include "container/segment_times.h"
#include "stgs/format/listed_segment.h"

namespace stgs {

struct ReaderLists {
  ReaderLists() = default;
  explicit ReaderLists(const FileHead& head);

  std::vector<SegmentInfo> segments;
  SegmentTimes times;
  std::vector<ScenePart> parts;  // without those that contain ends alone
  double complete_ticks = 0;     // the time up to which nothing is missing
  double latest_begin = 0;       // of a part, ticks

 private:
  // `numbers`: of the parts of the head in `parts`.
  ReaderLists(const FileHead& head, const std::vector<std::uint32_t>& numbers);
};

// SceneReader::ended_segments(), for the head of a file.
std::vector<std::uint32_t> ended_segments(const FileHead& head, std::vector<std::uint64_t> known);

// ListedSegment::of() and replace_segments(), for the head of a file.
ListedSegment listed_segment(const FileHead& head, std::uint32_t number);
void replace_segments(const ListedSegment& segment, std::span<const SegmentEnd> ends,
                      FileHead& head);

}  // namespace stgs
