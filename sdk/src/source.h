// SPDX-License-Identifier: Apache-2.0
// Memory and callbacks of the caller as a ByteSource.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <memory_resource>
#include <new>
#include <span>
#include <string>

#include "stgs/format/byte_source.h"
#include "stgs/stgs.h"

namespace stgs::sdk {

// Returns a source of bytes that it does not copy. Messages contain the name; empty: "memory".
std::unique_ptr<ByteSource> borrowed_source(std::span<const std::uint8_t> bytes,
                                            const std::string& name = {});
// Returns a source of a copy of the bytes in memory of this resource, which it retains.
std::unique_ptr<ByteSource> copied_source(std::span<const std::uint8_t> bytes,
                                          std::shared_ptr<std::pmr::memory_resource> memory,
                                          const std::string& name = {});

// The size of a callback source: `size`, or the last result of current_size. Thread-safe.
class CallerSize {
 public:
  template <typename Io>
  explicit CallerSize(const Io& io)
      : user_(io.user), current_size_(io.current_size), bytes_(io.size) {}
  std::uint64_t bytes() const { return bytes_; }
  bool may_grow() const { return current_size_ != nullptr; }
  // Queries current_size; kReplaced if it is less than `kept`.
  ByteSource::Change refresh(std::uint64_t kept);

 private:
  void* user_;
  std::uint64_t (*current_size_)(void*);
  std::atomic<std::uint64_t> bytes_;
};

// Creates a Caller, which closes the source when it is destroyed. Closes the source at once if
// there is no memory for it.
template <typename Caller, typename Io>
std::shared_ptr<Caller> share_caller(const Io& io) {
  try {
    return std::make_shared<Caller>(io);
  } catch (const std::bad_alloc&) {
    if (io.close != nullptr) io.close(io.user);
    throw;
  }
}

// A source of callbacks and its interrupt. The last of the two to be destroyed closes it.
struct CallerSource {
  std::unique_ptr<ByteSource> source;
  std::function<void()> interrupt;  // ends reads at once or soon; any thread, any number of times
};
// Messages contain the name; empty: "application source".
CallerSource callback_source(const stgs_io& io, const std::string& name = {});
CallerSource callback_source(const stgs_async_io& io);

}  // namespace stgs::sdk
