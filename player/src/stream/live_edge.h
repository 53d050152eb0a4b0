// SPDX-License-Identifier: Apache-2.0
// Where the edge of a recording is between the stretches that come, and how to keep behind it.
#pragma once

#include <algorithm>
#include <deque>

#include "stgs/player/player.h"

namespace stgs::player {

// A recording comes in stretches, each once it is over, and so does its edge. Whoever is to see all
// of it without standing still has to be as far behind as a stretch is long, and as the latest of
// them comes late against the earliest. Moments of the clip and a clock that never goes back, both
// in seconds. Not thread-safe.
class LiveEdge {
 public:
  // `edge`: where it is to begin with; `stretch`: how long the last one is that there is.
  LiveEdge(const LiveSettings& settings, double edge, double stretch)
      : settings_(settings), stretch_(stretch), edge_(edge) {}

  // The recording can be played up to `edge`, as is found at `now`; its last stretch is so long.
  // The first time tells nothing of when the edge came to be there.
  void observe(double edge, double stretch, double now);
  // The same where that tells nothing of when it came: nobody looked, or it cannot be played yet.
  void extend_to(double edge) { edge_ = std::max(edge_, edge); }

  // Where it is, taken to move on with the clock until the next stretch is overdue.
  double edge(double now) const;
  // How far behind it to be.
  double target_latency() const;
  double target(double now) const { return edge(now) - target_latency(); }
  // What a rate of 1 is to be instead, 0.9 to 1.1, to get from a moment to the target.
  double rate_factor(double moment, double now) const;
  // Whether the moment is so far behind the target that it is not to be caught up with.
  bool should_skip(double moment, double now) const;

 private:
  struct Arrival {
    double ahead = 0;  // of the clock, the edge
    double stretch = 0;
  };
  double earliest() const;
  double longest() const;
  double jitter() const;

  const LiveSettings settings_;
  double stretch_ = 0, edge_ = 0;
  double first_ahead_ = 0;
  bool joined_ = false;
  std::deque<Arrival> arrivals_;  // the last of them
};

}  // namespace stgs::player
