// SPDX-License-Identifier: Apache-2.0
// Lets a poll detect that the file was replaced.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

namespace stgs::player {

inline constexpr std::size_t kMaxComparedHead = 4096;  // bytes that a poll reads

// Returns whether the file that began with `head` was replaced, or cut within its first
// `stable_bytes`. `now` and `total`: its current first bytes and size.
inline bool is_other_file(std::span<const std::uint8_t> head, std::uint64_t stable_bytes,
                          std::span<const std::uint8_t> now, std::uint64_t total) {
  const std::size_t compared = std::min(head.size(), kMaxComparedHead);
  return total < stable_bytes || now.size() < compared ||
         !std::equal(now.begin(), now.begin() + static_cast<std::ptrdiff_t>(compared),
                     head.begin());
}

}  // namespace stgs::player
