// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace stgs::player {

// Of a clock that is never set; only differences mean something.
inline double clock_seconds() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

}  // namespace stgs::player
