// SPDX-License-Identifier: Apache-2.0
// Callbacks that an application passes to the C interface (memory, threads, log). They abort if the
// library calls them otherwise than the header specifies.
#pragma once

#include <map>
#include <mutex>
#include <new>
#include <thread>

#include "fuzz_target.h"
#include "stgs/stgs.h"

namespace stgs::fuzz {

// An allocator that checks each block when it is freed. Thread-safe.
class TestAllocator {
 public:
  // Makes every `nth` allocation from now on fail; 0: none.
  void fail_every(unsigned nth) {
    const std::lock_guard lock(mutex_);
    failure_interval_ = nth;
    requests_ = 0;
  }
  bool all_freed() {
    const std::lock_guard lock(mutex_);
    return blocks_.empty();
  }
  stgs_allocator callbacks() {
    stgs_allocator callbacks{};
    callbacks.struct_size = sizeof callbacks;
    callbacks.user = this;
    callbacks.allocate = [](void* user, std::size_t bytes, std::size_t alignment) {
      return static_cast<TestAllocator*>(user)->allocate(bytes, alignment);
    };
    callbacks.free = [](void* user, void* memory, std::size_t bytes, std::size_t alignment) {
      static_cast<TestAllocator*>(user)->free(memory, {bytes, alignment});
    };
    return callbacks;
  }

 private:
  struct Block {
    std::size_t bytes, alignment;
    bool operator==(const Block&) const = default;
  };

  void* allocate(std::size_t bytes, std::size_t alignment) {
    require(bytes > 0 && alignment > 0 && (alignment & (alignment - 1)) == 0,
            "an allocation has a size and an alignment that is a power of 2");
    const std::lock_guard lock(mutex_);
    if (failure_interval_ != 0 && ++requests_ % failure_interval_ == 0) return nullptr;
    void* const memory = ::operator new(bytes, std::align_val_t(alignment));
    blocks_[memory] = {bytes, alignment};
    return memory;
  }
  void free(void* memory, const Block& block) {
    const std::lock_guard lock(mutex_);
    const auto found = blocks_.find(memory);
    require(found != blocks_.end() && found->second == block,
            "a freed block has its original size and alignment");
    blocks_.erase(found);
    ::operator delete(memory, std::align_val_t(block.alignment));
  }

  std::mutex mutex_;
  unsigned failure_interval_ = 0, requests_ = 0;
  std::map<void*, Block> blocks_;
};

enum class RunnerKind { kOneThread, kSequential, kTwoThreads };

inline stgs_task_runner make_task_runner(RunnerKind kind) {
  using Task = void (*)(void*);
  constexpr Task kNone = nullptr;
  stgs_task_runner runner{};
  runner.struct_size = sizeof runner;
  runner.threads = kind == RunnerKind::kOneThread ? 1 : 3;
  switch (kind) {
    case RunnerKind::kOneThread:
      runner.run = [](void*, Task task, void* argument, std::uint32_t count) {
        require(task != kNone && count == 1, "a task runs on at most the stated number of threads");
        task(argument);
      };
      break;
    case RunnerKind::kSequential:
      runner.run = [](void*, Task task, void* argument, std::uint32_t count) {
        require(task != kNone && count >= 1 && count <= 3,
                "a task runs on at most the stated number of threads");
        for (std::uint32_t i = 0; i < count; ++i) task(argument);
      };
      break;
    case RunnerKind::kTwoThreads:
      runner.run = [](void*, Task task, void* argument, std::uint32_t count) {
        require(task != kNone && count >= 1 && count <= 3,
                "a task runs on at most the stated number of threads");
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
  require(level >= STGS_LOG_ERROR && level <= STGS_LOG_INFO, "a log line has a level");
  require(message != nullptr && *message != '\0', "a log line is not empty");
}

}  // namespace stgs::fuzz
