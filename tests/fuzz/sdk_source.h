// SPDX-License-Identifier: Apache-2.0
// Sources that an application passes to the C interface. They fail, grow, change and complete late,
// and abort if the library calls them otherwise than the header specifies.
#pragma once

#include <algorithm>
#include <cstring>
#include <mutex>
#include <utility>

#include "fuzz_target.h"
#include "stgs/stgs.h"

namespace stgs::fuzz {

// Thread-safe. Outlives its close() and its pending reads.
class TestSource {
 public:
  struct Behaviour {
    unsigned fail_every = 0;  // every n-th read fails; 0: none
    bool grows = false;       // provides current_size
    bool deferred = false;    // as stgs_async_io: reads complete in complete_reads()
  };
  TestSource(Bytes bytes, std::uint64_t size, const Behaviour& behaviour)
      : bytes_(std::move(bytes)), behaviour_(behaviour), size_(size), max_size_(size) {}
  TestSource(const TestSource&) = delete;
  TestSource& operator=(const TestSource&) = delete;

  stgs_io io() {
    stgs_io io = make_io<stgs_io>();
    io.read = [](void* user, std::uint64_t offset, void* out, std::size_t bytes) {
      auto* const source = static_cast<TestSource*>(user);
      source->begin_read(offset, bytes);
      return source->end_read(offset, out, bytes);
    };
    return io;
  }
  stgs_async_io async_io() {
    stgs_async_io io = make_io<stgs_async_io>();
    io.begin = [](void* user, stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
      auto* const source = static_cast<TestSource*>(user);
      source->begin_read(offset, bytes);
      if (source->behaviour_.deferred) return source->defer({read, offset, out, bytes});
      stgs_read_complete(read, source->end_read(offset, out, bytes));
    };
    return io;
  }

  // Sets the reported size; there may be fewer bytes.
  void resize(std::uint64_t size) {
    const std::lock_guard lock(mutex_);
    size_ = size;
    max_size_ = std::max(max_size_, size);
  }
  void replace_bytes(Bytes bytes) {
    const std::lock_guard lock(mutex_);
    bytes_ = std::move(bytes);
  }
  // Completes the pending reads on the calling thread; all fail if `failing`.
  void complete_reads(bool failing) {
    std::vector<PendingRead> pending;
    {
      const std::lock_guard lock(mutex_);
      pending.swap(pending_);
    }
    for (const PendingRead& one : pending) {
      const int error = end_read(one.offset, one.out, one.bytes);
      stgs_read_complete(one.read, failing ? 1 : error);
    }
  }
  bool is_deferred() const { return behaviour_.deferred; }
  bool has_pending_reads() {
    const std::lock_guard lock(mutex_);
    return !pending_.empty();
  }
  bool is_closed() {
    const std::lock_guard lock(mutex_);
    return closed_;
  }

 private:
  struct PendingRead {
    stgs_read* read;
    std::uint64_t offset;
    void* out;
    std::size_t bytes;
  };

  template <typename Io>
  Io make_io() {
    Io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.size = size_;
    io.close = [](void* user) { static_cast<TestSource*>(user)->close(); };
    io.interrupt = [](void* user) { static_cast<TestSource*>(user)->interrupt(); };
    if (behaviour_.grows) {
      io.current_size = [](void* user) { return static_cast<TestSource*>(user)->current_size(); };
    }
    return io;
  }

  void begin_read(std::uint64_t offset, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    require(!closed_, "a closed source is not read");
    require(bytes <= max_size_ && offset <= max_size_ - bytes,
            "reads lie within the reported size");
    ++in_flight_;
  }
  int end_read(std::uint64_t offset, void* out, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    --in_flight_;
    if (behaviour_.fail_every != 0 && ++reads_ % behaviour_.fail_every == 0) return 5;
    if (bytes > bytes_.size() || offset > bytes_.size() - bytes) return 6;
    std::memcpy(out, bytes_.data() + offset, bytes);
    return 0;
  }
  void defer(const PendingRead& read) {
    const std::lock_guard lock(mutex_);
    pending_.push_back(read);
  }
  void close() {
    const std::lock_guard lock(mutex_);
    require(!closed_ && in_flight_ == 0, "a source is closed once, after all reads have completed");
    closed_ = true;
  }
  void interrupt() {
    const std::lock_guard lock(mutex_);
    require(!closed_ && !interrupted_, "a source is interrupted at most once, before it is closed");
    interrupted_ = true;
  }
  std::uint64_t current_size() {
    const std::lock_guard lock(mutex_);
    require(!closed_, "the size of a closed source is not queried");
    return size_;
  }

  std::mutex mutex_;
  Bytes bytes_;
  const Behaviour behaviour_;
  std::uint64_t size_, max_size_;
  unsigned reads_ = 0, in_flight_ = 0;
  bool closed_ = false, interrupted_ = false;
  std::vector<PendingRead> pending_;
};

}  // namespace stgs::fuzz
