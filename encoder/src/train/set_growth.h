// SPDX-License-Identifier: Apache-2.0
// When static primitives join the persistent set of a long capture. Those that do not join yet are
// candidates: part of their window's content, stored with it, and trained further in the next.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stgs::encoder {

// The set settles in its first minute: candidates join once they are kJoinShare of it, so that few
// parts of the file cover a time. Afterwards, every kLateInterval seconds, the most important ones
// join, up to kLateShare of the set, so a still scene grows by at most 2 % per minute. If
// candidates are more than kChangedShare of the set, the scene has changed, and all join.
inline constexpr double kSettleSeconds = 60, kJoinShare = 0.02;
inline constexpr double kLateInterval = 30, kLateShare = 0.01;
inline constexpr double kChangedShare = 0.1;

// The time from when the set was recorded to the end of a window, seconds since the start of the
// recording.
struct RecordedSpan {
  double begin = 0, end = 0;
};

// Returns the candidates (ascending) that join a set of `stored` primitives at the end of a window,
// ascending; all join an empty set. `importance`: of all primitives of the state; empty: unknown,
// and the first candidates count as the most important.
std::vector<std::uint32_t> choose_joining(const std::vector<std::uint32_t>& candidates,
                                          std::size_t stored, std::span<const float> importance,
                                          const RecordedSpan& since_set);

}  // namespace stgs::encoder
