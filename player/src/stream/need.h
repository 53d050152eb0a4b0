// SPDX-License-Identifier: Apache-2.0
// How soon each piece of a file is needed by somebody who watches it: what to fetch next, and what
// can be dropped first.
#pragma once

#include <cstdint>

#include "stgs/format/scene_file.h"

namespace stgs::player {

// Where a viewer is in the clip, and which way he goes.
struct Playhead {
  double ticks = 0;             // in [0, duration]
  double ticks_per_second = 1;  // below 0: backwards; not 0 (who pauses is about to go on)
  double duration = 0;          // ticks
  bool loop = false;            // after the end the beginning follows, and the other way round
  bool still = false;           // he stays where he is, for how long nobody knows
};

// Seconds from now; `from` = infinity: never again.
struct Need {
  double from = 0;   // until a moment first lies in the segment
  double until = 0;  // until the last one does, before it comes round again; infinity: nobody knows
};

// When moments of [begin, end] of the timeline are shown.
Need need_of(double begin, double end, const Playhead& motion);

// A file comes in pieces: of each segment its base, and its harmonics where they are apart. Pieces
// of one layer make a picture better alike: the bases of a tier, then all harmonics of a tier.
struct Piece {
  std::uint32_t segment = 0;
  bool harmonics = false;

  bool operator==(const Piece&) const = default;
};

// Layer 0 alone is a picture of all the space; `tiers` of the file.
int layer_of(const SegmentInfo& segment, bool harmonics, int tiers);

// How long a piece can wait, seconds: a piece of layer l is as urgent as one of layer 0 that is
// needed l * patience later. So layer 0 is fetched furthest ahead, the next a patience less, and
// where a link cannot carry all layers those on top come too late to be fetched at all, without any
// estimate of what it carries.
double deadline(const Need& need, int layer, double patience);

}  // namespace stgs::player
