// SPDX-License-Identifier: Apache-2.0
// Standard input as a file, for the argument "-".
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "stgs/format/status.h"

namespace stgs::tools {

// Returns whether an argument selects standard input.
inline bool is_standard_input(const std::string& argument) {
  return argument == "-";
}

// Returns all bytes of standard input, read on the first call; they stay valid. kUsage if it is a
// terminal, kIo if it cannot be read.
Result<std::span<const std::uint8_t>> read_standard_input();

}  // namespace stgs::tools
