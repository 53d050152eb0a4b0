// SPDX-License-Identifier: Apache-2.0
// What an application lends to the C interface: memory, threads and a log that end the process
// where they are called otherwise than the header says.
#pragma once

#include <map>
#include <mutex>
#include <new>
#include <thread>

#include "fuzz_target.h"
#include "stgs/stgs.h"

namespace stgs::fuzz {

// Memory that must come back as it went. Thread-safe.
class LentMemory {
 public:
  // From now on; 0: there is always some.
  void fail_each(unsigned nth) {
    const std::lock_guard lock(mutex_);
    each_ = nth;
    requests_ = 0;
  }
  bool all_is_back() {
    const std::lock_guard lock(mutex_);
    return given_.empty();
  }
  stgs_allocator hook() {
    stgs_allocator hook{};
    hook.struct_size = sizeof hook;
    hook.user = this;
    hook.allocate = [](void* user, std::size_t bytes, std::size_t alignment) {
      return static_cast<LentMemory*>(user)->allocate(bytes, alignment);
    };
    hook.free = [](void* user, void* memory, std::size_t bytes, std::size_t alignment) {
      static_cast<LentMemory*>(user)->free(memory, {bytes, alignment});
    };
    return hook;
  }

 private:
  struct Block {
    std::size_t bytes, alignment;
    bool operator==(const Block&) const = default;
  };

  void* allocate(std::size_t bytes, std::size_t alignment) {
    require(bytes > 0 && alignment > 0 && (alignment & (alignment - 1)) == 0,
            "some bytes are asked for, at a multiple of a power of 2");
    const std::lock_guard lock(mutex_);
    if (each_ != 0 && ++requests_ % each_ == 0) return nullptr;
    void* const memory = ::operator new(bytes, std::align_val_t(alignment));
    given_[memory] = {bytes, alignment};
    return memory;
  }
  void free(void* memory, const Block& block) {
    const std::lock_guard lock(mutex_);
    const auto found = given_.find(memory);
    require(found != given_.end() && found->second == block, "what is given back was lent so");
    given_.erase(found);
    ::operator delete(memory, std::align_val_t(block.alignment));
  }

  std::mutex mutex_;
  unsigned each_ = 0, requests_ = 0;
  std::map<void*, Block> given_;
};

enum class Runner { kOnce, kAllInTurn, kTwoThreads };

inline stgs_task_runner lent_threads(Runner how) {
  using Task = void (*)(void*);
  constexpr Task kNone = nullptr;
  stgs_task_runner runner{};
  runner.struct_size = sizeof runner;
  runner.threads = how == Runner::kOnce ? 1 : 3;
  switch (how) {
    case Runner::kOnce:
      runner.run = [](void*, Task task, void* argument, std::uint32_t count) {
        require(task != kNone && count == 1, "no more calls than there are threads");
        task(argument);
      };
      break;
    case Runner::kAllInTurn:
      runner.run = [](void*, Task task, void* argument, std::uint32_t count) {
        require(task != kNone && count >= 1 && count <= 3, "no more calls than there are threads");
        for (std::uint32_t i = 0; i < count; ++i) task(argument);
      };
      break;
    case Runner::kTwoThreads:
      runner.run = [](void*, Task task, void* argument, std::uint32_t count) {
        require(task != kNone && count >= 1 && count <= 3, "no more calls than there are threads");
        std::thread other;
        if (count > 1) other = std::thread(task, argument);
        task(argument);
        if (other.joinable()) other.join();
      };
      break;
  }
  return runner;
}

inline void check_log_line(void*, stgs_log_level level, const char* message) {
  require(level >= STGS_LOG_ERROR && level <= STGS_LOG_INFO, "a line has a level");
  require(message != nullptr && *message != '\0', "a line says something");
}

}  // namespace stgs::fuzz
