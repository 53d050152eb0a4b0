// SPDX-License-Identifier: Apache-2.0
// Locates and removes the copy of a file's head (COPY record).
#pragma once

#include <xxhash.h>

#include <cstdint>
#include <cstring>
#include <vector>

namespace stgs::testing {

// Offset of the COPY record that ends a finished file; the file size if there is none.
inline std::size_t copy_at(const std::vector<std::uint8_t>& bytes) {
  constexpr std::size_t kRecord = 32;
  std::uint64_t length = 0;
  if (bytes.size() < kRecord + sizeof length) return bytes.size();
  std::memcpy(&length, bytes.data() + bytes.size() - sizeof length, sizeof length);
  if (length > bytes.size() - kRecord) return bytes.size();
  const std::size_t at = bytes.size() - kRecord - length;
  return std::memcmp(bytes.data() + at, "COPY", 4) == 0 ? at : bytes.size();
}

// A finished file of this minor version without its COPY record. Damage to its head is not
// repaired.
inline std::vector<std::uint8_t> without_copy(std::vector<std::uint8_t> bytes,
                                              std::uint16_t minor = 1) {
  const std::uint64_t size = copy_at(bytes);
  if (size == bytes.size()) return bytes;
  bytes.resize(size);
  std::memcpy(bytes.data() + 10, &minor, sizeof minor);
  std::memcpy(bytes.data() + 16, &size, sizeof size);
  const std::uint64_t sum = XXH3_64bits(bytes.data(), 32);
  std::memcpy(bytes.data() + 32, &sum, sizeof sum);
  return bytes;
}

}  // namespace stgs::testing
