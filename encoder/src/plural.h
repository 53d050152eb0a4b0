// SPDX-License-Identifier: Apache-2.0
// Counts in messages.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace stgs::encoder {

// Returns "1 frame" or "12 frames" for nouns with a regular plural.
inline std::string plural(std::uint64_t count, std::string_view noun) {
  return std::to_string(count) + " " + std::string(noun) + (count == 1 ? "" : "s");
}

}  // namespace stgs::encoder
