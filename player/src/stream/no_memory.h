// SPDX-License-Identifier: Apache-2.0
// Error handling without memory, for threads that must keep running.
#pragma once

#include <algorithm>
#include <cstdint>
#include <exception>
#include <new>
#include <string_view>
#include <vector>

#include "stgs/player/player.h"

namespace stgs::player {

inline constexpr const char* kNoMemory = "out of memory";  // fits the small-string buffer

// Returns the status for an exception. Its message is the result of describe(), or kNoMemory if
// there is no memory for that.
template <typename Describe>
Status failure(const std::exception& e, const Describe& describe) noexcept {
  try {
    return {code_of(e), describe()};
  } catch (const std::exception&) {
    return {code_of(e), kNoMemory};
  }
}

// Returns an event with a byte offset. Its message is kNoMemory if there is no memory for
// `message`.
inline PlayerEvent event_of(PlayerEvent::Kind kind, std::uint64_t offset, StatusCode code,
                            std::string_view message) noexcept {
  PlayerEvent event;
  event.kind = kind;
  event.offset = offset;
  event.code = code;
  try {
    event.message = message;
  } catch (const std::bad_alloc&) {
    event.message = kNoMemory;
  }
  return event;
}

// Reserves capacity so that growing to `size` elements does not throw. Grows geometrically.
template <typename T>
void reserve_for(std::vector<T>& list, std::size_t size) {
  if (list.capacity() < size) list.reserve(std::max(size, 2 * list.capacity()));
}

}  // namespace stgs::player
