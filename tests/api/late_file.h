// SPDX-License-Identifier: Apache-2.0
// A source of the application's that answers its reads when it is told to.
#pragma once

#include <cstring>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "stgs/stgs.h"

namespace stgs::testing {

// Thread-safe. The bytes are borrowed.
class LateFile {
 public:
  explicit LateFile(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  // Nobody waits for an answer for ever.
  ~LateFile() { answer(1); }
  LateFile(const LateFile&) = delete;
  LateFile& operator=(const LateFile&) = delete;

  stgs_async_io io() {
    stgs_async_io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.size = bytes_.size();
    io.begin = [](void* user, stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
      static_cast<LateFile*>(user)->begin(read, offset, out, bytes);
    };
    return io;
  }

  void begin(stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    waiting_.push_back({read, offset, out, bytes});
  }
  // Each read that waits, on the thread that calls: fate() is its error, 0 for its bytes, or
  // nothing where it goes on waiting.
  template <typename Fate>
  void answer_each(Fate&& fate) {
    std::vector<Waiting> waiting;
    {
      const std::lock_guard lock(mutex_);
      waiting.swap(waiting_);
    }
    for (const Waiting& one : waiting) {
      if (const std::optional<int> error = fate()) {
        std::memcpy(one.out, bytes_.data() + one.offset, one.bytes);
        stgs_read_complete(one.read, *error);
      } else {
        begin(one.read, one.offset, one.out, one.bytes);
      }
    }
  }
  void answer(int error) {
    answer_each([error] { return std::optional(error); });
  }
  std::size_t waiting() {
    const std::lock_guard lock(mutex_);
    return waiting_.size();
  }

 private:
  struct Waiting {
    stgs_read* read;
    std::uint64_t offset;
    void* out;
    std::size_t bytes;
  };

  const std::span<const std::uint8_t> bytes_;
  std::mutex mutex_;
  std::vector<Waiting> waiting_;
};

}  // namespace stgs::testing
