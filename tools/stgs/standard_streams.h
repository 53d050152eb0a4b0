// SPDX-License-Identifier: Apache-2.0
// Standard input and output as files, for the argument "-", and standard error. After SIGINT or
// SIGTERM none of them waits for another program any more (kRuntime; messages are lost).
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

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
// Writes to standard error. Errors are ignored: there is nowhere to report them. Thread-safe.
void write_standard_error(std::string_view text);
// Reserves the descriptors 0 to 2 that the caller of the program has closed, so that no file gets
// them; reading and writing there fail. Call first.
void reserve_standard_streams();
// Returns whether standard error is a terminal.
bool is_terminal_standard_error();
// Discards all that libraries write to descriptor 2 from now on, but not write_standard_error():
// decoders of images print texts of their input there, and cannot be interrupted while they do.
// Call while no other thread writes.
void silence_libraries();

}  // namespace stgs::tools
