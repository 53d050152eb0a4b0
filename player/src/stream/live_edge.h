// SPDX-License-Identifier: Apache-2.0
// Estimates the live edge of a growing recording, and how far behind it to play.
#pragma once

#include <algorithm>
#include <deque>

#include "stgs/player/player.h"

namespace stgs::player {

// A recording grows by fragments, each of which arrives once it is complete. To play without
// stalls, the latency must be at least the duration of a fragment plus the jitter of the arrivals:
// the delay of the latest fragment relative to the earliest. `time` and `edge` are clip times,
// `now` is the time of a monotonic clock, all in seconds. Not thread-safe.
class LiveEdge {
 public:
  // `edge`: the initial edge; `fragment`: the duration of the last fragment present.
  LiveEdge(const LiveSettings& settings, double edge, double fragment)
      : settings_(settings), fragment_(fragment), edge_(edge) {}

  // Records that at `now` the recording is playable up to `edge`, and that its last fragment has
  // the duration `fragment`. The time at which the edge was reached is unknown at the first call.
  void observe(double edge, double fragment, double now);
  // Records an edge whose time of arrival is unknown: nobody polled, or it is not playable yet.
  void extend_to(double edge) { edge_ = std::max(edge_, edge); }
  // Sets LiveSettings::latency_seconds.
  void set_latency(double seconds) { settings_.latency_seconds = seconds; }

  // Returns the estimated edge, which advances with the clock until the next fragment is overdue.
  double edge(double now) const;
  // Returns the latency to keep.
  double target_latency() const;
  // Returns the clip time at the target latency.
  double target(double now) const { return edge(now) - target_latency(); }
  // Returns the factor by which to change a rate of 1, 0.9 to 1.1, to get from `time` to the
  // target.
  double rate_factor(double time, double now) const;
  // Returns whether `time` is too far behind the target to catch up by playing faster.
  bool should_skip(double time, double now) const;

 private:
  struct Arrival {
    double ahead = 0;  // edge minus clock
    double fragment = 0;
  };
  double max_ahead() const;
  double max_fragment() const;
  double jitter() const;

  LiveSettings settings_;
  double fragment_ = 0, edge_ = 0;
  double first_ahead_ = 0;
  bool has_observed_ = false;
  std::deque<Arrival> arrivals_;  // the most recent ones
};

}  // namespace stgs::player
