// SPDX-License-Identifier: Apache-2.0
// Drives a follower on a thread.
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

#include "stream/follower.h"

namespace stgs::player {

// Calls Follower::step() whenever it is due, on a thread that ends when the follower is done or
// this object is destroyed. Thread-safe.
class FollowThread {
 public:
  // `follower` is not used after stop().
  explicit FollowThread(Follower& follower) : follower_(follower), thread_([this] { run(); }) {}
  // Waits for a read in progress, which ends by itself or when its source is interrupted.
  ~FollowThread();
  FollowThread(const FollowThread&) = delete;
  FollowThread& operator=(const FollowThread&) = delete;

  // Starts no further reads, even for a load in progress.
  void stop() noexcept;
  // Checks at once whether playback needs further parts of the index.
  void wake() noexcept;

 private:
  void run();

  Follower& follower_;
  std::mutex mutex_;  // guards the following members
  std::condition_variable changed_;
  bool stopping_ = false, woken_ = false;
  std::thread thread_;
};

}  // namespace stgs::player
