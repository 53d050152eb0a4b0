// SPDX-License-Identifier: Apache-2.0
// Times short work.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>

namespace stgs::bench {

// Seconds of the fastest run; runs repeat for 0.2 s, at least once.
template <typename Work>
double min_seconds(Work work) {
  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  double best = 1e30;
  do {
    const auto start = Clock::now();
    work();
    best = std::min(best, std::chrono::duration<double>(Clock::now() - start).count());
  } while (Clock::now() - begin < std::chrono::milliseconds(200));
  return best;
}

// Millions of items per second by min_seconds, to a tenth.
template <typename Work>
double millions_per_second(std::size_t items, Work work) {
  return std::round(static_cast<double>(items) / min_seconds(work) / 1e5) / 10.0;
}

}  // namespace stgs::bench
