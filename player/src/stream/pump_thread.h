// SPDX-License-Identifier: Apache-2.0
// Drives a segment store on threads.
#pragma once

#include <condition_variable>
#include <limits>
#include <mutex>
#include <thread>

#include "stream/segment_store.h"

namespace stgs::player {

// Calls SegmentStore::pump() whenever there is something to do, on a thread of its own. Two other
// threads do so as well, to save a switch of threads: one whose read or decoder has just ended, and
// one that seeks, which makes a single step. Thread-safe.
class PumpThread {
 public:
  // `store` is not used after stop().
  explicit PumpThread(SegmentStore& store) : store_(store), thread_([this] { run(); }) {}
  ~PumpThread() { stop(); }
  PumpThread(const PumpThread&) = delete;
  PumpThread& operator=(const PumpThread&) = delete;

  // Calls pump() on this thread, unless another one is doing so, which then repeats it; or makes
  // the thread call it soon.
  void wake(WakeReason reason) noexcept;
  // Ends the thread and waits for calls of pump(). Later calls of the other functions do nothing.
  void stop() noexcept;

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  void run();
  void pump(std::unique_lock<std::mutex>& lock, double budget) noexcept;
  void sleep(std::unique_lock<std::mutex>& lock);

  SegmentStore& store_;
  std::mutex mutex_;  // guards the following members
  std::condition_variable changed_;
  bool woken_ = false, pumping_ = false, stopping_ = false;
  double wake_at_ = kNever;         // as of the last pump(), clock seconds
  double sleeping_until_ = kNever;  // of the thread
  std::thread thread_;
};

}  // namespace stgs::player
