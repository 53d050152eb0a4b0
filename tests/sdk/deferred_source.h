// SPDX-License-Identifier: Apache-2.0
// An asynchronous source of the application that completes its reads on demand.
#pragma once

#include <cstring>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "stgs/stgs.h"

namespace stgs::testing {

// Thread-safe. Borrows the bytes.
class DeferredSource {
 public:
  explicit DeferredSource(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  // Fails all pending reads, so that no player waits for them.
  ~DeferredSource() { complete(1); }
  DeferredSource(const DeferredSource&) = delete;
  DeferredSource& operator=(const DeferredSource&) = delete;

  stgs_async_io io() {
    stgs_async_io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.size = bytes_.size();
    io.begin = [](void* user, stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
      static_cast<DeferredSource*>(user)->begin(read, offset, out, bytes);
    };
    return io;
  }

  void begin(stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    pending_.push_back({read, offset, out, bytes});
  }
  // Completes the pending reads on the calling thread. `outcome` is called once per read and
  // returns its error code (0: success), or nullopt to leave the read pending.
  template <typename Outcome>
  void complete_each(Outcome&& outcome) {
    std::vector<Read> reads;
    {
      const std::lock_guard lock(mutex_);
      reads.swap(pending_);
    }
    for (const Read& read : reads) {
      if (const std::optional<int> error = outcome()) {
        std::memcpy(read.out, bytes_.data() + read.offset, read.bytes);
        stgs_read_complete(read.handle, *error);
      } else {
        begin(read.handle, read.offset, read.out, read.bytes);
      }
    }
  }
  void complete(int error) {
    complete_each([error] { return std::optional(error); });
  }
  std::size_t pending() {
    const std::lock_guard lock(mutex_);
    return pending_.size();
  }

 private:
  struct Read {
    stgs_read* handle;
    std::uint64_t offset;
    void* out;
    std::size_t bytes;
  };

  const std::span<const std::uint8_t> bytes_;
  std::mutex mutex_;
  std::vector<Read> pending_;
};

}  // namespace stgs::testing
