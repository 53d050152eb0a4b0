// SPDX-License-Identifier: Apache-2.0
// When each segment is needed next: decides what to fetch first and what to evict first.
#pragma once

#include <cstdint>

#include "stgs/format/scene_file.h"

namespace stgs::player {

// The playback position and how it moves.
struct Playhead {
  double ticks = 0;             // in [0, duration]
  double ticks_per_second = 1;  // negative: backwards; never 0, also while paused
  double duration = 0;          // ticks
  bool loop = false;            // playback wraps around at both ends
  bool stationary = false;      // the position stays where it is for an unknown time

  bool operator==(const Playhead&) const = default;
};

// When a segment is needed, seconds from now.
struct Need {
  double from = 0;   // until its first time is displayed; infinity: never
  double until = 0;  // until its last time is displayed, before the next loop; infinity: unknown
};

// Returns when times in [begin, end], ticks, are displayed.
Need need_of(double begin, double end, const Playhead& playhead);

// The base of a segment, or its spherical harmonics if they are stored separately. The same parts
// of all segments of a tier form a layer of the file: first the bases of each tier, then the
// spherical harmonics of each tier.
struct SegmentLayer {
  std::uint32_t segment = 0;
  bool sh = false;

  bool operator==(const SegmentLayer&) const = default;
};

// Returns the layer of the file, given its number of tiers. Layer 0 alone covers all space.
int layer_of(const SegmentInfo& segment, bool sh, int tiers);

// Returns the deadline by which segment layers are scheduled, seconds from now: layer l is as
// urgent as a part of layer 0 that is needed l * lead later. Layer 0 is thus fetched furthest
// ahead. On a link that cannot carry all layers, the top ones become too late to be fetched at all,
// without any estimate of the throughput.
double deadline(const Need& need, int layer, double lead);

}  // namespace stgs::player
