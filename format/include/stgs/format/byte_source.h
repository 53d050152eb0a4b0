// SPDX-License-Identifier: Apache-2.0
// Random access to bytes that may be a file, memory, or something further away.
#pragma once

#include <cstdint>
#include <functional>
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
  // Whether refresh() may find more.
  virtual bool may_grow() const { return false; }
  // Looks again how large it is. Of the first `kept` bytes the caller knows that they stay; what
  // follows them may have become longer or shorter. kReplaced: these are not all there any more, or
  // it is another file; the source is as it was then. Thread-safe.
  enum class Change { kNone, kResized, kReplaced };
  virtual Result<Change> refresh(std::uint64_t kept) {
    (void)kept;
    return Change::kNone;
  }
  // The caller knows that nothing is added to the file as it is now: whatever changes makes it
  // another. Thread-safe.
  virtual void set_finished() {}
  // Whether bytes that were there when it was opened, or looked at last, have gone; answers at
  // once. False where that is not known. Thread-safe.
  virtual bool has_shrunk() const { return false; }
  // The same of whether a finished file was written to since set_finished().
  virtual bool was_modified() const { return false; }
  // Fills `out` from `offset`; an error if any byte lies past the end. Thread-safe.
  virtual Status read(std::uint64_t offset, std::span<std::uint8_t> out) const = 0;
  // The same, but a source that waits for others gives it up (kRuntime) within half a second of
  // `should_continue` answering false, which it asks now and then, on this thread. That does not
  // throw.
  virtual Status read_while(const std::function<bool()>& should_continue, std::uint64_t offset,
                            std::span<std::uint8_t> out) const {
    (void)should_continue;
    return read(offset, out);
  }
  // What messages call it: a path, or "memory".
  virtual const std::string& name() const = 0;
};

// An error where the source, `size` bytes long, ends before `bytes` from `offset` on do.
Status check_range(const std::string& name, std::uint64_t size, std::uint64_t offset,
                   std::uint64_t bytes);

Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);
// Of a file that is open for reading. Takes the descriptor, also after an error; `path` is its name
// in messages, and where refresh() looks.
Result<std::unique_ptr<ByteSource>> descriptor_source(int descriptor, const std::string& path);
// Takes the bytes.
std::unique_ptr<ByteSource> memory_source(std::vector<std::uint8_t> bytes,
                                          std::string name = "memory");

}  // namespace stgs
