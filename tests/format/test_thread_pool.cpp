// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/thread_pool.h"

#include <array>
#include <atomic>
#include <chrono>
#include <ctime>
#include <stdexcept>
#include <thread>
#include <vector>

#include "catch.h"
#include "fixtures/loop_threads.h"
#include "stgs/format/parallel.h"

using namespace stgs;

namespace {

// Counts the threads that are inside at the same time, and lets them wait for each other.
class Crowd {
 public:
  // Counts the calling thread, and waits until `expected` threads were inside at the same time, at
  // most a minute.
  void visit(int expected) {
    const int now = ++inside_;
    int most = most_;
    while (most < now && !most_.compare_exchange_weak(most, now)) {
    }
    const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (most_ < expected && std::chrono::steady_clock::now() < end) std::this_thread::yield();
    std::this_thread::sleep_for(kStep);  // gives excess threads the time to enter
    --inside_;
  }
  int most() const { return most_; }

 private:
  static constexpr std::chrono::milliseconds kStep{2};
  std::atomic<int> inside_{0}, most_{0};
};

// Returns the number of threads that worked on a loop at the same time, once `expected` have.
int most_threads(int expected) {
  Crowd crowd;
  parallel_for(0, 24, [&](int) { crowd.visit(expected); });
  return crowd.most();
}

}  // namespace

TEST_CASE("a loop visits each index once, on all threads of its pool") {
  for (const int threads : {1, 2, 5}) {
    const testing::LoopThreads limit(threads);
    CHECK(most_threads(threads) == threads);
    std::vector<std::atomic<int>> visits(1000);
    std::atomic<int> elsewhere = 0;
    parallel_for(std::size_t{0}, visits.size(), [&](std::size_t i) {
      ++visits[i];
      elsewhere += concurrency() == threads ? 0 : 1;
    });
    for (const std::atomic<int>& count : visits) CHECK(count == 1);
    CHECK(elsewhere == 0);  // nested loops use the same pool
  }
}

TEST_CASE("nested loops and loops of several threads share the threads of one pool") {
  ThreadPool pool(4);
  Crowd crowd;
  std::atomic<int> visits = 0;
  const auto nested = [&] {
    const ScopedTaskRunner use(&pool);
    parallel_for(0, 6, [&](int) {
      parallel_blocks(0, 30, 10, [&](int first, int last) {
        crowd.visit(3);
        visits += last - first;
      });
    });
  };
  std::array<std::thread, 3> callers;
  for (std::thread& caller : callers) caller = std::thread(nested);
  for (std::thread& caller : callers) caller.join();
  CHECK(visits == 3 * 6 * 30);
  CHECK(crowd.most() <= 3 + 3);  // the callers, and the threads of the pool
}

TEST_CASE("many short loops visit every index") {
  ThreadPool pool(8);
  const ScopedTaskRunner use(&pool);
  std::atomic<int> visits = 0;
  for (int i = 0; i < 20000; ++i) parallel_for(0, 1 + i % 9, [&](int) { ++visits; });
  int expected = 0;
  for (int i = 0; i < 20000; ++i) expected += 1 + i % 9;
  CHECK(visits == expected);
}

TEST_CASE("the threads of a pool sleep when no loop is running") {
  ThreadPool pool(4);
  std::atomic<int> visits = 0;
  const auto run_loops = [&] {
    const ScopedTaskRunner use(&pool);
    for (int i = 0; i < 2000; ++i) parallel_for(0, 2, [&](int) { ++visits; });
  };
  std::array<std::thread, 3> callers;
  for (std::thread& caller : callers) caller = std::thread(run_loops);
  for (std::thread& caller : callers) caller.join();
  CHECK(visits == 3 * 2000 * 2);
  constexpr std::chrono::milliseconds kPause(200);
  std::this_thread::sleep_for(kPause / 10);
  const std::clock_t before = std::clock();  // CPU time of the process
  std::this_thread::sleep_for(kPause);
  CHECK(1000.0 * static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC < kPause.count() / 2);
}

TEST_CASE("an exception ends a loop, and its pool can be used again") {
  const testing::LoopThreads limit(3);
  std::atomic<int> visits = 0;
  const auto fail = [&] {
    parallel_blocks(0, 1000, 1, [&](int i, int) {
      ++visits;
      if (i == 5) throw std::runtime_error("five");
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    });
  };
  CHECK_THROWS_WITH(fail(), "five");
  CHECK(visits < 1000);
  visits = 0;
  parallel_for(0, 100, [&](int) { ++visits; });
  CHECK(visits == 100);
}

TEST_CASE(
    "a pool can be resized between loops, and a stopped pool runs loops on their calling thread") {
  ThreadPool pool(1);
  const ScopedTaskRunner use(&pool);
  CHECK(most_threads(1) == 1);
  pool.set_threads(4);
  CHECK(most_threads(4) == 4);
  pool.set_threads(2);
  CHECK(most_threads(2) == 2);
  pool.set_threads(0);
  CHECK(concurrency() == 1);
  pool.set_threads(4);
  pool.stop();
  CHECK(most_threads(1) == 1);
}
