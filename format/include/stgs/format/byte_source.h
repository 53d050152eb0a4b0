// SPDX-License-Identifier: Apache-2.0
// Random access to bytes that may be a file, memory, or something further away.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

class ByteSource {
 public:
  virtual ~ByteSource() = default;
  // Total size in bytes.
  virtual std::uint64_t size() const = 0;
  // Looks again how large it is, where it may have grown. Not while another thread uses it.
  virtual Status refresh() { return {}; }
  // Fills `out` from `offset`; an error if any byte lies past the end. Thread-safe.
  virtual Status read(std::uint64_t offset, std::span<std::uint8_t> out) const = 0;
  // What messages call it: a path, or "memory".
  virtual const std::string& name() const = 0;
};

// An error where the source, `size` bytes long, ends before `bytes` from `offset` on do.
Status check_range(const std::string& name, std::uint64_t size, std::uint64_t offset,
                   std::uint64_t bytes);

Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);
// Takes the bytes.
std::unique_ptr<ByteSource> memory_source(std::vector<std::uint8_t> bytes,
                                          std::string name = "memory");

}  // namespace stgs
