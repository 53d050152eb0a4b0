// SPDX-License-Identifier: Apache-2.0
#include "stream/need.h"

#include <cmath>
#include <limits>

namespace stgs::player {

Need need_of(double begin, double end, const Playhead& motion) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const double speed = std::abs(motion.ticks_per_second);
  // As for somebody who goes forwards from 0.
  const bool back = motion.ticks_per_second < 0;
  const double first = back ? motion.ticks - end : begin - motion.ticks;
  const double last = back ? motion.ticks - begin : end - motion.ticks;
  if (first <= 0 && last >= 0) return {0, motion.still ? kNever : last / speed};
  if (first > 0) return {first / speed, motion.still ? kNever : last / speed};
  if (!motion.loop) return {kNever, kNever};
  return {(first + motion.duration) / speed, (last + motion.duration) / speed};
}

int layer_of(const SegmentInfo& segment, bool harmonics, int tiers) {
  return harmonics ? tiers + segment.tier : segment.tier;
}

double deadline(const Need& need, int layer, double patience) {
  return need.from + layer * patience;
}

}  // namespace stgs::player
