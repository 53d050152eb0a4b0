// SPDX-License-Identifier: Apache-2.0
// How many primitives a scene needs at a time, by the tiers that are shown.
#pragma once

#include <cstdint>
#include <vector>

#include "stgs/format/scene_file.h"

namespace stgs::player {

// Returns, for each number of tiers from 1 to `tiers`, the greatest number of primitives of these
// first tiers that are needed at one time. The tiers of `segments` are below `tiers`.
std::vector<std::uint64_t> tier_peaks(const std::vector<SegmentInfo>& segments, int tiers);

}  // namespace stgs::player
