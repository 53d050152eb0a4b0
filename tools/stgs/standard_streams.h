// SPDX-License-Identifier: Apache-2.0
// Standard input and output as files, for the argument "-". After SIGINT or SIGTERM neither waits
// for another program any more (kRuntime).
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "stgs/format/status.h"

namespace stgs::tools {

// The advice for a scene from standard input that exceeds the memory for it (--memory).
inline constexpr const char* kStandardInputAdvice = "allow more memory, or name a file";

// Returns whether an argument selects standard input.
inline bool is_standard_input(const std::string& argument) {
  return argument == "-";
}

// Returns all bytes of standard input, read on the first call; they stay valid. kUsage if it is a
// terminal, kIo if it cannot be read, kLimit if it has more than `max_bytes`, which are the most
// that are read; `advice` completes that message.
Result<std::span<const std::uint8_t>> read_standard_input(std::uint64_t max_bytes,
                                                          const char* advice);
// Writes to standard output.
Status write_standard_output(std::span<const std::uint8_t> bytes);

}  // namespace stgs::tools
