// SPDX-License-Identifier: Apache-2.0
// The interval at which a growing recording is polled.
#pragma once

#include <algorithm>

namespace stgs::player {

// Polls often when the next fragment is due, and rarely while none arrives. Times are seconds of a
// monotonic clock. Not thread-safe.
class PollInterval {
 public:
  static constexpr double kMinSeconds = 0.01, kMaxSeconds = 2;

  PollInterval(double shortest, double now)
      : shortest_(std::clamp(shortest, kMinSeconds, kMaxSeconds)), seconds_(0), grown_at_(now) {}

  // Returns the time from the last poll to the next.
  double seconds() const { return seconds_; }
  // Returns the time since the recording last grew.
  double idle_seconds(double now) const { return now - grown_at_; }
  // Records whether the poll at `now` found that the recording has grown.
  void update(bool grown, double now) {
    if (grown) {
      between_ = has_polled_ ? now - grown_at_ : 0;
      grown_at_ = now;
      seconds_ = std::clamp(between_ / 2, shortest_, kMaxSeconds);
    } else if (idle_seconds(now) <= std::max(2 * between_, 1.0)) {
      seconds_ = shortest_;
    } else {
      seconds_ = std::min(std::max(2 * seconds_, shortest_), kMaxSeconds);
    }
    has_polled_ = true;
  }

 private:
  const double shortest_;
  double seconds_;
  double grown_at_;
  double between_ = 0;  // the last two times that it grew; 0: unknown
  bool has_polled_ = false;
};

}  // namespace stgs::player
