// SPDX-License-Identifier: Apache-2.0
// The thread pool of the loops in stgs/format/parallel.h. A loop never depends on it: the calling
// thread also works on the loop, no loop allocates memory, and a thread that cannot be started is
// left out. Loops therefore complete, with the same result, without free memory or threads.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

#include "stgs/format/task_runner.h"

namespace stgs {

// A TaskRunner with its own threads, which are started on demand. Thread-safe unless stated
// otherwise.
class ThreadPool final : public TaskRunner {
 public:
  // `threads` includes the calling thread of a loop, and is clamped to [1, 4096]. Throws
  // std::bad_alloc.
  explicit ThreadPool(int threads);
  // Requires that no loop runs.
  ~ThreadPool() override;
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int threads() const override { return limit_; }
  void run(void (*work)(void* argument), void* argument, int count) override;
  // Changes the number of threads. Requires that no loop runs. Throws std::bad_alloc.
  void set_threads(int threads);
  // Ends all threads, and joins them if no loop is running; otherwise the process is exiting, and
  // they are detached. Later loops run on their calling threads alone.
  void stop() noexcept;

 private:
  // A running loop.
  struct alignas(64) Offer {
    std::atomic<std::uint32_t> state{0};  // threads that may still join << 16 | threads inside
    void (*work)(void* argument) = nullptr;
    void* argument = nullptr;
  };
  static constexpr int kOffers = 64;  // further loops run on their calling threads alone

  Offer* claim_offer();
  void start_threads(int wanted) noexcept;
  void wake_some();
  Offer* join_loop();
  void finish(Offer& offer);
  std::uint64_t bit_of(const Offer& offer) const;
  void serve();

  std::array<Offer, kOffers> offers_;
  std::atomic<std::uint64_t> claimed_{0};  // bits of offers in use
  std::atomic<std::uint64_t> open_{0};     // bits of offers that threads may join
  std::atomic<int> limit_;                 // threads, including the calling one
  std::atomic<int> busy_{0};               // threads of the pool in a loop
  std::atomic<int> started_{0};            // threads of the pool
  std::atomic<int> asleep_{0};             // threads that wait for `wakes_`
  std::atomic<std::uint32_t> wakes_{0};    // incremented to wake threads
  std::atomic<bool> stopping_{false};
  std::mutex mutex_;  // guards `threads_`
  std::vector<std::thread> threads_;
};

// Returns the pool for threads without a TaskRunner, with one thread per core in the affinity mask
// of the process. Throws std::bad_alloc. The threads end when the process exits or the library that
// contains the pool is unloaded.
ThreadPool& default_thread_pool();

}  // namespace stgs
