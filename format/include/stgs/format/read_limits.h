// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>

namespace stgs {

// Limits that a reader enforces before it allocates memory. The defaults are meant for files of
// strangers.
struct ReadLimits {
  static constexpr std::uint64_t kDefaultMemory = std::uint64_t{4} << 30;

  std::uint64_t max_primitives = 200'000'000;
  // Bytes for one segment, including everything needed to decode it. When a complete scene is read,
  // also for its floats (spec/conformance.md, 1.5). When a file of another format is imported, for
  // everything that the import holds at a time.
  std::uint64_t max_memory = kDefaultMemory;
  // Bytes for opening or validating a file, without decoding. 0: 56 MiB and 4 for each byte of the
  // head and the index that is read; for the entries of the index 4 MiB and 40, if that is less.
  std::uint64_t max_opening = 0;
  // Values that a validator decodes: floats, symbols, and other work as
  // its equivalent (spec/conformance.md, 1.5). A few times as many as files of real scenes have. 0:
  // 2^21 and 16 for each byte of the file.
  std::uint64_t max_values = 0;

  // Returns the limits of a caller who allows `memory` bytes. If that is more than the default, it
  // is for opening as well, and a validator decodes everything.
  static ReadLimits of(std::uint64_t primitives, std::uint64_t memory) {
    if (memory <= kDefaultMemory) return {primitives, memory};
    return {primitives, memory, memory, std::numeric_limits<std::uint64_t>::max()};
  }
};

}  // namespace stgs
