// SPDX-License-Identifier: Apache-2.0
// Random-access reading of bytes from a file, from memory or from a remote source.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "stgs/format/status.h"

namespace stgs {

// A readable range of bytes. The const member functions are thread-safe.
class ByteSource {
 public:
  // The result of refresh().
  enum class Change {
    kNone,      // the size is the same
    kResized,   // bytes were added, or bytes after the stable ones were removed
    kReplaced,  // stable bytes are gone, or another file has taken the name
  };

  virtual ~ByteSource() = default;
  // Returns the size in bytes, as of opening or the last refresh().
  virtual std::uint64_t size() const = 0;
  // Returns whether refresh() can find more bytes.
  virtual bool may_grow() const { return false; }
  // Updates size(). The first `stable_bytes` are expected to stay; the bytes after them may have
  // been extended or cut. After kReplaced the source is unchanged. Thread-safe.
  virtual Result<Change> refresh(std::uint64_t stable_bytes) {
    (void)stable_bytes;
    return Change::kNone;
  }
  // Declares the file complete: from now on any change makes it a different file. Thread-safe.
  virtual void set_finished() {}
  // Returns whether the file is now shorter than size(); false if unknown. Never waits.
  // Thread-safe.
  virtual bool has_shrunk() const { return false; }
  // Returns whether the file was written to since set_finished(); false if unknown. Never waits.
  // Thread-safe.
  virtual bool was_modified() const { return false; }
  // Returns whether a read or refresh() of a source that cannot wait has failed because bytes have
  // not arrived yet. Repeat the call once this returns false.
  virtual bool is_pending() const { return false; }
  // Returns whether these bytes can be read without waiting.
  virtual bool has(std::uint64_t offset, std::uint64_t bytes) const {
    (void)offset, (void)bytes;
    return true;
  }
  // Fills `out` with the bytes from `offset` on. Fails if any of them lies past the end.
  // Thread-safe.
  virtual Status read(std::uint64_t offset, std::span<std::uint8_t> out) const = 0;
  // As read(), but a source that waits for a remote peer gives up (kRuntime) at most half a second
  // after `should_continue` returns false. It is polled on the calling thread and must not throw.
  virtual Status read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                            std::span<std::uint8_t> out) const {
    (void)should_continue;
    return read(offset, out);
  }
  // Returns the name used in messages: a path, or "memory".
  virtual const std::string& name() const = 0;
};

// Returns kInvalidFile if [offset, offset + bytes) does not lie within a source of `size` bytes.
// `name` is for the message.
Status check_range(const std::string& name, std::uint64_t size, std::uint64_t offset,
                   std::uint64_t bytes);

// Checks that an open descriptor is that of a regular file; kIo otherwise. `path`: for the message.
Status check_regular(int descriptor, const std::string& path);

// Opens a regular file for reading.
Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);
// Wraps a descriptor that is open for reading. Takes ownership of it, even after an error. `path`
// is the name in messages and the path that refresh() checks.
Result<std::unique_ptr<ByteSource>> descriptor_source(int descriptor, const std::string& path);
// Wraps bytes in memory.
std::unique_ptr<ByteSource> memory_source(std::vector<std::uint8_t> bytes,
                                          std::string name = "memory");

}  // namespace stgs
