// SPDX-License-Identifier: Apache-2.0
// What reading and writing an index have in common: how places are told, and in what order.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "container.h"

namespace stgs {

inline constexpr int kMaxLevel = 30;
inline constexpr std::uint64_t kApart = 1, kMore = 2;  // bits of a segment's shape, spec 5.3
inline constexpr std::uint64_t kCut = 1, kChunk = 2;   // bits beside a part's skip
inline constexpr int kSkipShift = 2;

// Order of the segments of a part: by beginning, the longer first (spec 5.6).
inline bool comes_before(const IndexEntry& a, const IndexEntry& b, double chunk) {
  if (a.level < 0 || b.level < 0) return a.level < 0 && b.level >= 0;
  const double begin_a = begin_of(a.level, a.slot, chunk);
  const double begin_b = begin_of(b.level, b.slot, chunk);
  return begin_a != begin_b ? begin_a < begin_b : a.level > b.level;
}

// The place of a segment as one number: small where it follows the last one of its level in a part.
class Places {
 public:
  std::uint64_t number_of(const IndexEntry& entry) {
    std::uint64_t& next = next_[static_cast<std::size_t>(entry.level + 1)];
    const std::uint64_t number = (entry.slot - next) << 5 | static_cast<unsigned>(entry.level + 1);
    next = std::uint64_t{entry.slot} + 1;
    return number;
  }
  // False where there is no such slot.
  bool place_of(std::uint64_t number, IndexEntry& entry) {
    std::uint64_t& next = next_[number & 31];
    const std::uint64_t step = number >> 5;
    const std::uint64_t last = (number & 31) == 0 ? 0 : std::numeric_limits<std::uint32_t>::max();
    if (next > last || step > last - next) return false;
    entry.level = static_cast<std::int16_t>(static_cast<int>(number & 31) - 1);
    entry.slot = static_cast<std::uint32_t>(next + step);
    next = std::uint64_t{entry.slot} + 1;
    return true;
  }

 private:
  std::array<std::uint64_t, kMaxLevel + 2> next_{};
};

}  // namespace stgs
