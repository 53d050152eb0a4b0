// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace stgs::player {

// Returns the time of a monotonic clock, seconds. Only differences are meaningful.
inline double clock_seconds() {
  const auto since_epoch = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double>(since_epoch).count();
}

}  // namespace stgs::player
