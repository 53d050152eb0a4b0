// SPDX-License-Identifier: Apache-2.0
// The number of primitives that a scene needs at one time, by the number of tiers shown.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs::player {

// Returns, for n = 1 to `tiers`, the maximum number of primitives of the first n tiers that are
// needed at one time. The tiers of `segments` are below `tiers`.
std::vector<std::uint64_t> tier_peaks(const std::vector<SegmentInfo>& segments, int tiers);

}  // namespace stgs::player
