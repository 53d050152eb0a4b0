// SPDX-License-Identifier: Apache-2.0
// Division of a scene into segments of tiers.
#pragma once

#include <vector>

#include "quantise/segmenter.h"
#include "scene/body_write.h"

namespace stgs {

// A segment of one tier. Segments of equal importance and kind share layouts.
struct TierSegment {
  SegmentMembers segment;
  int importance = 0;  // tier in the plan
  int kind = 0;        // level, or negative: constant primitives, outliers
};

// Returns all segments of all parts, tier after tier, and lists them in the index of `body`.
std::vector<TierSegment> plan_segments(const Encoding& encoding,
                                       const std::vector<PartRange>& parts, Body& body);

}  // namespace stgs
