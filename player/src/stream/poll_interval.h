// SPDX-License-Identifier: Apache-2.0
// When to look again whether a recording has grown.
#pragma once

#include <algorithm>

namespace stgs::player {

// Often about when the next stretch is due, rarely where none comes. Seconds of a clock that never
// goes back. Not thread-safe.
class PollInterval {
 public:
  static constexpr double kMinSeconds = 0.01, kMaxSeconds = 2;  // seconds between looks

  PollInterval(double shortest, double now)
      : shortest_(std::clamp(shortest, kMinSeconds, kMaxSeconds)), wait_(0), grown_(now) {}

  // Seconds from the last look to the next.
  double seconds() const { return wait_; }
  // How long nothing has come.
  double idle_seconds(double now) const { return now - grown_; }
  // What the look at `now` found.
  void update(bool grown, double now) {
    if (grown) {
      between_ = looked_ ? now - grown_ : 0;
      grown_ = now;
      wait_ = std::clamp(between_ / 2, shortest_, kMaxSeconds);
    } else if (idle_seconds(now) <= std::max(2 * between_, 1.0)) {
      wait_ = shortest_;
    } else {
      wait_ = std::min(std::max(2 * wait_, shortest_), kMaxSeconds);
    }
    looked_ = true;
  }

 private:
  const double shortest_;
  double wait_;
  double grown_;
  double between_ = 0;  // the last two times that it had grown; 0: not known
  bool looked_ = false;
};

}  // namespace stgs::player
