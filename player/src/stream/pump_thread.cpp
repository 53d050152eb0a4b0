// SPDX-License-Identifier: Apache-2.0
#include "stream/pump_thread.h"

#include <chrono>
#include <cmath>

#include "stream/clock_seconds.h"

namespace stgs::player {

void PumpThread::wake(WakeReason reason) noexcept {
  {
    std::unique_lock lock(mutex_);
    woken_ = true;
    if (pumping_ || stopping_) return;
    if (reason != WakeReason::kChanged) pump(lock, reason == WakeReason::kJump ? 0 : kNever);
    const bool is_early = wake_at_ < sleeping_until_;
    if (!woken_ && !is_early && !stopping_) return;
  }
  changed_.notify_all();
}

void PumpThread::stop() noexcept {
  {
    std::unique_lock lock(mutex_);
    stopping_ = true;
    changed_.notify_all();
    changed_.wait(lock, [this] { return !pumping_; });
  }
  if (thread_.joinable()) thread_.join();
}

// Repeats pump() until there is nothing to do; with a budget of 0, makes a single step.
void PumpThread::pump(std::unique_lock<std::mutex>& lock, double budget) noexcept {
  pumping_ = true;
  do {
    woken_ = false;
    lock.unlock();
    const PumpResult result = store_.pump(clock_seconds(), budget);
    lock.lock();
    wake_at_ = result.wake_at;
    woken_ |= result.progressed;
  } while (woken_ && !stopping_ && budget > 0);
  pumping_ = false;
}

void PumpThread::run() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (!pumping_ && (woken_ || clock_seconds() >= wake_at_)) {
      pump(lock, kNever);
      changed_.notify_all();  // stop() may wait for this
    } else {
      sleep(lock);
    }
  }
}

void PumpThread::sleep(std::unique_lock<std::mutex>& lock) {
  // A thread that is calling pump() sets a new time.
  sleeping_until_ = pumping_ ? kNever : wake_at_;
  if (std::isinf(sleeping_until_)) return changed_.wait(lock);
  changed_.wait_for(lock, std::chrono::duration<double>(sleeping_until_ - clock_seconds()));
}

}  // namespace stgs::player
