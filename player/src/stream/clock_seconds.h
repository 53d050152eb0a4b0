// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace stgs::player {

// Returns the time of a monotonic clock, seconds. Only differences are meaningful.
inline double clock_seconds() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

}  // namespace stgs::player
