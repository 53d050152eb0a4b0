// SPDX-License-Identifier: Apache-2.0
// Files that only stgs reads, such as checkpoints: fields in native byte order, then a
// checksum. Every array is preceded by its length, which a reader compares with the bytes that
// remain before it allocates.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "stgs/format/status.h"

namespace stgs::encoder {

// Identifies the files of a kind, and words the errors about them.
struct ArchiveKind {
  char magic[8];              // the last byte is the layout version; the others never change
  const char* noun;           // "checkpoint"
  const char* if_damaged;     // the remedy for a damaged file
  const char* if_other;       // the remedy for a file of another version of stgs
  std::uint64_t max_bytes{};  // of a file; 0: not limited
};

class ArchiveWriter {
 public:
  // `kind` must outlive the object.
  explicit ArchiveWriter(const ArchiveKind& kind);

  template <typename T>
  void value(const T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    const auto* p = reinterpret_cast<const std::uint8_t*>(&v);
    bytes_.insert(bytes_.end(), p, p + sizeof(T));
  }
  template <typename Container>
  void array(const Container& v) {
    using T = typename Container::value_type;
    static_assert(std::is_trivially_copyable_v<T>);
    value(static_cast<std::uint64_t>(v.size()));
    const auto* p = reinterpret_cast<const std::uint8_t*>(v.data());
    bytes_.insert(bytes_.end(), p, p + v.size() * sizeof(T));
  }
  // Writes the fields under a temporary name, then renames. kIo on failure; kUnsupported for a
  // larger file than a reader accepts. Only the destructor may follow.
  Status save(const std::string& path);

 private:
  const ArchiveKind& kind_;
  std::vector<std::uint8_t> bytes_;
};

// After a field that the file lacks, all further ones are unchanged.
class ArchiveReader {
 public:
  // Reads a file and checks its kind and checksum. kIo, kInvalidFile if it is damaged, kUnsupported
  // if it has the layout of another version.
  static Result<ArchiveReader> open(const std::string& path, const ArchiveKind& kind);

  template <typename T>
  void value(T& v) {
    static_assert(std::is_trivially_copyable_v<T>);
    take(&v, sizeof(T));
  }
  template <typename Container>
  void array(Container& v) {
    using T = typename Container::value_type;
    static_assert(std::is_trivially_copyable_v<T>);
    std::uint64_t n = 0;
    value(n);
    if (failed_) return;
    if (n > left().size() / sizeof(T)) {
      failed_ = true;
      return;
    }
    v.resize(n);
    take(v.data(), n * sizeof(T));
  }
  bool ok() const { return !failed_; }
  // Returns whether all fields were read, and nothing follows them.
  bool complete() const { return ok() && left().empty(); }

 private:
  std::span<const std::uint8_t> left() const {
    return std::span(bytes_).subspan(position_, end_ - position_);
  }
  void take(void* to, std::size_t n) {
    if (failed_ || n > left().size()) {
      failed_ = true;
      return;
    }
    if (n > 0) std::memcpy(to, left().data(), n);
    position_ += n;
  }

  std::vector<std::uint8_t> bytes_;     // the complete file
  std::size_t position_ = 0, end_ = 0;  // of the fields that remain
  bool failed_ = false;
};

}  // namespace stgs::encoder
