// SPDX-License-Identifier: Apache-2.0
#include "stgs/format/thread_pool.h"

#include <pthread.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <exception>

namespace stgs {

namespace {

// Waking a thread takes tens of microseconds, and the next loop often starts sooner.
constexpr std::chrono::microseconds kSpinTime(100);

// Spins until done() returns true, at most for kSpinTime.
template <typename Done>
void spin(const Done& done) {
  const auto end = std::chrono::steady_clock::now() + kSpinTime;
  while (!done() && std::chrono::steady_clock::now() < end) std::this_thread::yield();
}

// One thread that may still join, in Offer::state.
constexpr std::uint32_t kMayJoin = 1 << 16;

}  // namespace

ThreadPool::ThreadPool(int threads) {
  set_threads(threads);
}

ThreadPool::~ThreadPool() {
  stop();
}

void ThreadPool::set_threads(int threads) {
  constexpr int kMaxThreads = 4096;
  stop();
  limit_ = std::clamp(threads, 1, kMaxThreads);
  threads_.reserve(static_cast<std::size_t>(limit_ - 1));
  stopping_ = false;
}

void ThreadPool::stop() noexcept {
  bool idle = false;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;  // no thread is added any more
    idle = busy_ == 0;
  }
  ++wakes_;
  wakes_.notify_all();
  for (std::thread& thread : threads_) idle ? thread.join() : thread.detach();
  threads_.clear();
  started_ = 0;
}

// Starts threads until `wanted` are free, the limit is reached, or the system refuses one.
void ThreadPool::start_threads(int wanted) noexcept {
  const auto missing = [&] { return started_ < std::min(limit_ - 1, busy_ + wanted); };
  if (!missing()) return;
  try {
    const std::lock_guard lock(mutex_);
    while (!stopping_ && missing()) {
      threads_.emplace_back([this] { serve(); });
      ++started_;
    }
  } catch (const std::exception&) {  // the loop runs on fewer threads
  }
}

std::uint64_t ThreadPool::bit_of(const Offer& offer) const {
  return std::uint64_t{1} << (&offer - offers_.data());
}

// Returns an offer that no other loop uses; null: there is none.
ThreadPool::Offer* ThreadPool::claim_offer() {
  for (std::uint64_t claimed = claimed_; ~claimed != 0;) {
    Offer& offer = offers_[static_cast<std::size_t>(std::countr_one(claimed))];
    if (claimed_.compare_exchange_weak(claimed, claimed | bit_of(offer))) return &offer;
  }
  return nullptr;
}

// Wakes two threads. Each of them wakes two more while a loop is open, so that a short loop wakes
// few threads, and a long one wakes all in a logarithmic number of steps.
void ThreadPool::wake_some() {
  if (open_ == 0 || asleep_ == 0) return;
  ++wakes_;
  wakes_.notify_one();
  wakes_.notify_one();
}

// Joins an open loop; null: there is none. finish() waits until this thread has left the loop.
ThreadPool::Offer* ThreadPool::join_loop() {
  for (std::uint64_t open = open_; open != 0;) {
    Offer& offer = offers_[static_cast<std::size_t>(std::countr_zero(open))];
    std::uint32_t state = offer.state;
    while (state >= kMayJoin) {
      if (!offer.state.compare_exchange_weak(state, state - kMayJoin + 1)) continue;
      if (state < 2 * kMayJoin) open_ &= ~bit_of(offer);  // this was the last thread
      return &offer;
    }
    open &= ~bit_of(offer);
  }
  return nullptr;
}

// Closes a loop and waits for the threads inside.
void ThreadPool::finish(Offer& offer) {
  const std::uint32_t before = offer.state.fetch_and(kMayJoin - 1);
  if (before >= kMayJoin) open_ &= ~bit_of(offer);
  spin([&offer] { return offer.state == 0; });
  for (std::uint32_t inside = offer.state; inside != 0; inside = offer.state) {
    offer.state.wait(inside);
  }
  claimed_ &= ~bit_of(offer);
}

void ThreadPool::serve() {
  (void)pthread_setname_np(pthread_self(), "stgs-pool");
  while (!stopping_) {
    if (Offer* const offer = join_loop()) {
      ++busy_;
      wake_some();
      offer->work(offer->argument);
      --busy_;
      if (--offer->state == 0) offer->state.notify_one();
      continue;
    }
    spin([this] { return open_ != 0 || stopping_; });
    const std::uint32_t before = wakes_;
    ++asleep_;  // before the check, so that a loop opened after it wakes this thread
    if (open_ == 0 && !stopping_) wakes_.wait(before);
    --asleep_;
  }
}

void ThreadPool::run(void (*work)(void* argument), void* argument, int count) {
  const int others = std::min(count, threads()) - 1;
  Offer* const offer = others > 0 && !stopping_ ? claim_offer() : nullptr;
  if (offer == nullptr) return work(argument);
  offer->work = work;
  offer->argument = argument;
  // The bit first: the last thread that joins clears it.
  open_ |= bit_of(*offer);
  offer->state = static_cast<std::uint32_t>(others) * kMayJoin;
  start_threads(others);
  wake_some();
  work(argument);
  finish(*offer);
}

namespace {

// Returns the number of cores that the process may use.
int usable_cores() {
  for (int cores = 1024; cores <= 1 << 20; cores *= 4) {
    cpu_set_t* const set = CPU_ALLOC(cores);
    if (set == nullptr) break;
    const std::size_t bytes = CPU_ALLOC_SIZE(cores);
    const bool known = sched_getaffinity(0, bytes, set) == 0;
    const int usable = known ? CPU_COUNT_S(bytes, set) : 0;
    CPU_FREE(set);
    if (known) return std::max(usable, 1);
  }
  return std::max(static_cast<int>(std::thread::hardware_concurrency()), 1);
}

}  // namespace

ThreadPool& default_thread_pool() {
  // Never destroyed: other threads may start loops while the process exits.
  static ThreadPool* const pool = new ThreadPool(usable_cores());
  static const struct Stop {
    ~Stop() {
      if (getpid() == process) pool->stop();  // a child of fork() has no threads
    }
    pid_t process = getpid();
  } stop;
  return *pool;
}

}  // namespace stgs
