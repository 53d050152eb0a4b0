// SPDX-License-Identifier: Apache-2.0
// Bytes of the caller's as a ByteSource.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <memory_resource>
#include <new>
#include <span>

#include "stgs/format/byte_source.h"
#include "stgs/stgs.h"

namespace stgs::sdk {

// The bytes are not copied.
std::unique_ptr<ByteSource> borrowed_source(std::span<const std::uint8_t> bytes);
// They are, to memory of that kind, which the source keeps.
std::unique_ptr<ByteSource> copied_source(std::span<const std::uint8_t> bytes,
                                          std::shared_ptr<std::pmr::memory_resource> memory);

// How large a source of callbacks is: as it said when it was asked last, before that `size`.
// Thread-safe.
class CallerSize {
 public:
  template <typename Io>
  explicit CallerSize(const Io& io) : user_(io.user), ask_(io.current_size), bytes_(io.size) {}
  std::uint64_t bytes() const { return bytes_; }
  bool may_grow() const { return ask_ != nullptr; }
  ByteSource::Change refresh(std::uint64_t kept);

 private:
  void* user_;
  std::uint64_t (*ask_)(void*);
  std::atomic<std::uint64_t> bytes_;
};

// A Caller, which closes the source when it ends; where there is no memory for it, that is now.
template <typename Caller, typename Io>
std::shared_ptr<Caller> hold_caller(const Io& io) {
  try {
    return std::make_shared<Caller>(io);
  } catch (const std::bad_alloc&) {
    if (io.close != nullptr) io.close(io.user);
    throw;
  }
}

// A source of callbacks. Both hold it open: what is left of it is closed by the last that goes.
struct CallerSource {
  std::unique_ptr<ByteSource> source;
  std::function<void()> interrupt;  // reads end at once, or soon; any thread, any number of times
};
CallerSource callback_source(const stgs_io& io);
CallerSource callback_source(const stgs_async_io& io);

}  // namespace stgs::sdk
