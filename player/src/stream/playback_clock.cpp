// SPDX-License-Identifier: Apache-2.0
#include "stream/playback_clock.h"

#include <algorithm>
#include <cmath>

namespace stgs::player {

void PlaybackClock::seek(double ticks) {
  ticks_ = std::clamp(ticks, 0.0, last_);
}

PlaybackClock::Step PlaybackClock::after(double seconds) const {
  const double to = ticks_ + seconds * ticks_per_second();
  if (loop_) {
    const double round = last_ + 1;  // the last frame lasts one tick too
    const double inside = to - round * std::floor(to / round);
    return {inside, false, to < 0 || to >= round};
  }
  const bool ended = rate_ < 0 ? to <= 0 : to >= last_;
  return {std::clamp(to, 0.0, std::max(last_, ticks_)), ended, false};
}

}  // namespace stgs::player
