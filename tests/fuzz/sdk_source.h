// SPDX-License-Identifier: Apache-2.0
// Files of an application's for the C interface, which fail, grow, change and answer later, and end
// the process where they are called otherwise than the header says.
#pragma once

#include <algorithm>
#include <cstring>
#include <mutex>
#include <utility>

#include "fuzz_target.h"
#include "stgs/stgs.h"

namespace stgs::fuzz {

// Thread-safe. Lives until it is closed and its reads are answered.
class LentFile {
 public:
  struct Habits {
    unsigned fails_each = 0;  // reads; 0: none
    bool grows = false;       // it has current_size
    bool late = false;        // as an stgs_async_io: answers when it is told to
  };
  LentFile(Bytes bytes, std::uint64_t size, const Habits& habits)
      : bytes_(std::move(bytes)), habits_(habits), size_(size), most_(size) {}
  LentFile(const LentFile&) = delete;
  LentFile& operator=(const LentFile&) = delete;

  stgs_io io() {
    stgs_io io = common<stgs_io>();
    io.read = [](void* user, std::uint64_t offset, void* out, std::size_t bytes) {
      auto* const file = static_cast<LentFile*>(user);
      file->begin_read(offset, bytes);
      return file->end_read(offset, out, bytes);
    };
    return io;
  }
  stgs_async_io async_io() {
    stgs_async_io io = common<stgs_async_io>();
    io.begin = [](void* user, stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
      auto* const file = static_cast<LentFile*>(user);
      file->begin_read(offset, bytes);
      if (file->habits_.late) return file->keep({read, offset, out, bytes});
      stgs_read_complete(read, file->end_read(offset, out, bytes));
    };
    return io;
  }

  // How large it says that it is from now on; there may be fewer bytes.
  void resize(std::uint64_t size) {
    const std::lock_guard lock(mutex_);
    size_ = size;
    most_ = std::max(most_, size);
  }
  void become(Bytes bytes) {
    const std::lock_guard lock(mutex_);
    bytes_ = std::move(bytes);
  }
  // The reads that wait, on the thread that calls, `failing` or with what there is.
  void answer(bool failing) {
    std::vector<Waiting> waiting;
    {
      const std::lock_guard lock(mutex_);
      waiting.swap(waiting_);
    }
    for (const Waiting& one : waiting) {
      const int error = end_read(one.offset, one.out, one.bytes);
      stgs_read_complete(one.read, failing ? 1 : error);
    }
  }
  bool is_late() const { return habits_.late; }
  bool is_waited_for() {
    const std::lock_guard lock(mutex_);
    return !waiting_.empty();
  }
  bool is_closed() {
    const std::lock_guard lock(mutex_);
    return closed_;
  }

 private:
  struct Waiting {
    stgs_read* read;
    std::uint64_t offset;
    void* out;
    std::size_t bytes;
  };

  template <typename Io>
  Io common() {
    Io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.size = size_;
    io.close = [](void* user) { static_cast<LentFile*>(user)->close(); };
    io.interrupt = [](void* user) { static_cast<LentFile*>(user)->interrupt(); };
    if (habits_.grows) {
      io.current_size = [](void* user) { return static_cast<LentFile*>(user)->current_size(); };
    }
    return io;
  }

  void begin_read(std::uint64_t offset, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    require(!closed_, "what is closed is not read");
    require(bytes <= most_ && offset <= most_ - bytes, "reads lie within the size that was told");
    ++in_flight_;
  }
  int end_read(std::uint64_t offset, void* out, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    --in_flight_;
    if (habits_.fails_each != 0 && ++reads_ % habits_.fails_each == 0) return 5;
    if (bytes > bytes_.size() || offset > bytes_.size() - bytes) return 6;
    std::memcpy(out, bytes_.data() + offset, bytes);
    return 0;
  }
  void keep(const Waiting& read) {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(read);
  }
  void close() {
    const std::lock_guard lock(mutex_);
    require(!closed_ && in_flight_ == 0, "a source is closed once, when nothing is read any more");
    closed_ = true;
  }
  void interrupt() {
    const std::lock_guard lock(mutex_);
    require(!closed_ && !interrupted_, "a source is interrupted once at most, and before its end");
    interrupted_ = true;
  }
  std::uint64_t current_size() {
    const std::lock_guard lock(mutex_);
    require(!closed_, "what is closed is not asked");
    return size_;
  }

  std::mutex mutex_;
  Bytes bytes_;
  const Habits habits_;
  std::uint64_t size_, most_;
  unsigned reads_ = 0, in_flight_ = 0;
  bool closed_ = false, interrupted_ = false;
  std::vector<Waiting> waiting_;
};

}  // namespace stgs::fuzz
