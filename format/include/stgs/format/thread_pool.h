// SPDX-License-Identifier: Apache-2.0
// Threads that share the loops of stgs/format/parallel.h. A loop never depends on them: the thread
// that starts a loop also works on it, nothing is allocated per loop, and a thread that cannot be
// started is only missing. So loops end, with the same result, when memory or threads are short.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

#include "stgs/format/task_runner.h"

namespace stgs {

// A TaskRunner with threads of its own, which it starts when a loop first needs them. Thread-safe.
class ThreadPool final : public TaskRunner {
 public:
  // `threads` includes the thread that starts a loop; it is brought into [1, 4096]. Throws
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
  // Ends all threads. Waits for them, unless a loop runs: then the process is ending. Later loops
  // run on the threads that start them.
  void stop() noexcept;

 private:
  // A loop that threads may join.
  struct alignas(64) Offer {
    std::atomic<std::uint32_t> state{0};  // threads that may still join << 16 | threads inside
    void (*work)(void* argument) = nullptr;
    void* argument = nullptr;
  };
  static constexpr int kOffers = 64;  // a loop beyond runs on the thread that starts it

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
  std::atomic<int> limit_;                 // threads, including one that starts a loop
  std::atomic<int> busy_{0};               // threads of the pool in a loop
  std::atomic<int> started_{0};            // threads of the pool
  std::atomic<int> asleep_{0};             // threads that wait for `offered_`
  std::atomic<std::uint32_t> offered_{0};  // changes to wake threads
  std::atomic<bool> stopping_{false};
  std::mutex mutex_;  // guards `threads_`
  std::vector<std::thread> threads_;
};

// Returns the pool of loops on threads without a TaskRunner. It has a thread for each core that the
// process may use. Throws std::bad_alloc. Its threads end when the process or the library that
// contains it does.
ThreadPool& default_threads();

}  // namespace stgs
