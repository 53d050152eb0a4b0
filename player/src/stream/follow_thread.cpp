// SPDX-License-Identifier: Apache-2.0
#include "stream/follow_thread.h"

#include <algorithm>
#include <chrono>

#include "stream/clock_seconds.h"

namespace stgs::player {

FollowThread::~FollowThread() {
  stop();
  thread_.join();
}

void FollowThread::stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  follower_.stop();
  changed_.notify_all();
}

void FollowThread::wake() noexcept {
  {
    const std::lock_guard lock(mutex_);
    woken_ = true;
  }
  changed_.notify_all();
}

void FollowThread::run() {
  constexpr double kMaxSeconds = 3600;
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    woken_ = false;
    lock.unlock();
    const double wake_at = follower_.step();
    if (follower_.is_done()) return;
    lock.lock();
    const double seconds = std::clamp(wake_at - clock_seconds(), 0.0, kMaxSeconds);
    changed_.wait_for(lock, std::chrono::duration<double>(seconds),
                      [this] { return stopping_ || woken_; });
  }
}

}  // namespace stgs::player
