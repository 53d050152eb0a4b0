// SPDX-License-Identifier: Apache-2.0
// Polls a growing recording and hands new data to the segment store.
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <memory_resource>
#include <mutex>
#include <thread>

#include "stgs/player/player.h"
#include "stream/poll_interval.h"
#include "stream/segment_store.h"
#include "stream/snapshot_source.h"

namespace stgs::player {

// Runs a thread that ends with the recording or with this object. Reports each problem once, and
// again if it recurs after polls without one; keeps polling in any case.
class Follower {
 public:
  // `cache` is the one with which the reader of `store` was opened. Everything else outlives this
  // object. `on_replaced` receives true and a message if the file was replaced, and false once it
  // is the right one again.
  Follower(SegmentStore& store, std::shared_ptr<RangeSource> source, IndexCache cache,
           const PlayerSettings& settings,
           std::function<void(bool, const std::string&)> on_replaced);
  // Waits for a poll in progress, which ends by itself or when the source is interrupted.
  ~Follower();
  // Begins no further polls.
  void stop();
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

 private:
  enum class Problem {
    kNone,
    kUnreadable,
    kDamaged,  // the file is invalid
    kReplaced  // the file was replaced or truncated
  };

  void run();
  bool wait();
  bool poll();
  bool take_snapshot();
  void set_problem(Problem problem, const Status& status) noexcept;
  void report_stall(double now) noexcept;

  SegmentStore& store_;
  const std::shared_ptr<RangeSource> source_;
  const LiveSettings settings_;
  const ReadLimits limits_;
  std::pmr::memory_resource* const memory_;
  const std::function<void(bool, const std::string&)> on_replaced_;

  // Used by the thread only.
  IndexCache cache_;
  std::shared_ptr<const SceneReader> reader_;
  PollInterval interval_;
  Problem problem_ = Problem::kNone;
  bool stall_reported_ = false;
  bool retry_ = false;  // read the file again even if its size is unchanged

  std::mutex mutex_;
  std::condition_variable stopped_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace stgs::player
