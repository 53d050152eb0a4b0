// SPDX-License-Identifier: Apache-2.0
// What threads that must go on do where there is no memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <exception>
#include <new>
#include <string_view>
#include <vector>

#include "stgs/player/player.h"

namespace stgs::player {

inline constexpr const char* kNoMemory = "no memory";  // short enough for a string to take none

// Of what was thrown, in the words that words() gives where there is memory for them.
template <typename Words>
Status failure(const std::exception& e, const Words& words) noexcept {
  try {
    return {code_of(e), words()};
  } catch (const std::exception&) {
    return {code_of(e), kNoMemory};
  }
}

// Tells what went wrong at a byte of the file, in the same way.
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

// So that growing to `size` elements does not throw any more; a few more each time cost little.
template <typename T>
void reserve_for(std::vector<T>& list, std::size_t size) {
  if (list.capacity() < size) list.reserve(std::max(size, 2 * list.capacity()));
}

}  // namespace stgs::player
