// SPDX-License-Identifier: Apache-2.0
// The coding of segment keys in an index and their order, shared by reading and writing.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "container/index.h"

namespace stgs {

inline constexpr int kMaxLevel = 30;
// Bits of a segment's shape (spec 5.3).
inline constexpr std::uint64_t kSeparateSh = 1, kHasFurther = 2;

// The order of the segments of a run: by beginning, longer ones first (spec 5.6).
inline bool comes_before(const IndexEntry& a, const IndexEntry& b, double chunk) {
  if (a.level < 0 || b.level < 0) return a.level < 0 && b.level >= 0;
  const double begin_a = begin_of(a.level, a.slot, chunk);
  const double begin_b = begin_of(b.level, b.slot, chunk);
  return begin_a != begin_b ? begin_a < begin_b : a.level > b.level;
}

// Codes level and slot of a segment as one number, which is small if the segment follows the
// previous one of its level in the run. Use one object per run.
class SegmentKeyCoder {
 public:
  std::uint64_t encode(const IndexEntry& entry) {
    std::uint64_t& next = next_[static_cast<std::size_t>(entry.level + 1)];
    const std::uint64_t number = (entry.slot - next) << 5 | static_cast<unsigned>(entry.level + 1);
    next = std::uint64_t{entry.slot} + 1;
    return number;
  }
  // Returns false if the slot does not exist.
  bool decode(std::uint64_t number, IndexEntry& entry) {
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
