// SPDX-License-Identifier: Apache-2.0
// A file whose bytes the page provides, because WebAssembly cannot wait for a read.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/byte_source.h"

namespace stgs::web {

// Reads provided bytes. A read of others fails with kIo and notes the missing ones; opening a file
// is repeated after each such read, once the page has provided the bytes. One thread.
class ProvidedSource final : public ByteSource {
 public:
  struct Range {
    std::uint64_t offset = 0, bytes = 0;
  };

  ProvidedSource(std::string name, std::uint64_t size) : name_(std::move(name)), size_(size) {}

  std::uint64_t size() const override { return size_; }
  const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::uint8_t> out) const override;

  // Returns memory for bytes from `offset` on, which count as provided.
  std::span<std::uint8_t> provide(std::uint64_t offset, std::uint64_t bytes);
  // Returns the bytes that the last read lacked, and forgets them.
  std::optional<Range> take_missing();
  // Frees the provided bytes.
  void clear() { ranges_.clear(); }

 private:
  const std::string name_;
  const std::uint64_t size_;
  std::map<std::uint64_t, std::vector<std::uint8_t>> ranges_;  // by offset; may overlap
  mutable std::optional<Range> missing_;
};

}  // namespace stgs::web
