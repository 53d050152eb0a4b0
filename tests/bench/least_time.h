// SPDX-License-Identifier: Apache-2.0
// Timing of short work.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>

namespace stgs::bench {

// Seconds of the quickest of the runs that fit into 0.2 s; at least one.
template <typename Work>
double least_seconds(Work work) {
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

// Millions of things a second by least_seconds, to a tenth.
template <typename Work>
double millions_a_second(std::size_t things, Work work) {
  return std::round(static_cast<double>(things) / least_seconds(work) / 1e5) / 10.0;
}

}  // namespace stgs::bench
