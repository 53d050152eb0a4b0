// SPDX-License-Identifier: Apache-2.0
// A thread that drives a segment store.
#pragma once

#include <chrono>
#include <cmath>
#include <condition_variable>
#include <limits>
#include <mutex>
#include <thread>

#include "stream/clock_seconds.h"
#include "stream/segment_store.h"

namespace stgs::player {

// Calls SegmentStore::pump() whenever there is something to do. The destructor ends the thread.
class PumpThread {
 public:
  explicit PumpThread(SegmentStore& store) : store_(store), thread_([this] { run(); }) {
    store_.set_wake([this] { wake(); });
    wake();  // for what happened before
  }
  ~PumpThread() {
    store_.set_wake({});
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  PumpThread(const PumpThread&) = delete;
  PumpThread& operator=(const PumpThread&) = delete;

 private:
  void wake() {
    {
      const std::lock_guard lock(mutex_);
      woken_ = true;
    }
    changed_.notify_one();
  }
  void run() {
    std::unique_lock lock(mutex_);
    while (!stopping_) {
      woken_ = false;
      lock.unlock();
      const double wake_at =
          store_.pump(clock_seconds(), std::numeric_limits<double>::infinity()).wake_at;
      lock.lock();
      const auto is_due = [this] { return woken_ || stopping_; };
      if (std::isinf(wake_at)) {
        changed_.wait(lock, is_due);
      } else {
        changed_.wait_for(lock, std::chrono::duration<double>(wake_at - clock_seconds()), is_due);
      }
    }
  }

  SegmentStore& store_;
  std::mutex mutex_;  // guards the following members
  std::condition_variable changed_;
  bool woken_ = false, stopping_ = false;
  std::thread thread_;
};

}  // namespace stgs::player
