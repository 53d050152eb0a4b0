// SPDX-License-Identifier: Apache-2.0
// Primitives of a segment that end before their own lifespan does (spec 5.9).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "stgs/format/gaussian4d.h"

namespace stgs {

// A primitive is visible up to a time, and then fades with its sigma (representation 2.7).
struct SegmentEnd {
  std::uint32_t primitive = 0;  // index in the segment
  double ticks = 0;             // from the beginning of the part
  bool operator==(const SegmentEnd&) const = default;
};

// Ends the primitives [first, first + set.size()) of a segment. `ends` ascend by primitive. The set
// needs times and radii, and velocities if it has positions. Call it once for a decoded set.
void apply_ends(std::span<const SegmentEnd> ends, std::size_t first, Gaussians4D& set);

}  // namespace stgs
