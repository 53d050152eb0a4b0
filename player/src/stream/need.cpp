// SPDX-License-Identifier: Apache-2.0
#include "stream/need.h"

#include <cmath>
#include <limits>

namespace stgs::player {

Need need_of(double begin, double end, const Playhead& playhead) {
  constexpr double kNotNeeded = std::numeric_limits<double>::infinity();
  const double speed = std::abs(playhead.ticks_per_second);
  // Mirrored for backward playback, so that the playhead moves forwards from 0.
  const bool back = playhead.ticks_per_second < 0;
  const double first = back ? playhead.ticks - end : begin - playhead.ticks;
  const double last = back ? playhead.ticks - begin : end - playhead.ticks;
  if (first <= 0 && last >= 0) return {0, playhead.stationary ? kNotNeeded : last / speed};
  if (first > 0) return {first / speed, playhead.stationary ? kNotNeeded : last / speed};
  if (!playhead.loop) return {kNotNeeded, kNotNeeded};
  return {(first + playhead.duration) / speed, (last + playhead.duration) / speed};
}

int layer_of(const SegmentInfo& segment, bool sh, int tiers) {
  return sh ? tiers + segment.tier : segment.tier;
}

double deadline(const Need& need, int layer, double lead) {
  return need.from + layer * lead;
}

}  // namespace stgs::player
