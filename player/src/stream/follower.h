// SPDX-License-Identifier: Apache-2.0
// Looks whether a recording has grown, and what has come of it.
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

// Has a thread of its own, which ends with the recording or this. What goes wrong is told once, and
// again after it has been right; it goes on looking in any case.
class Follower {
 public:
  // `cache`: of the reader that `store` has. All but the cache outlive this. `on_replaced` is told
  // where the file is another one (true), and where it is the right one again.
  Follower(SegmentStore& store, std::shared_ptr<RangeSource> source, IndexCache cache,
           const PlayerSettings& settings,
           std::function<void(bool, const std::string&)> on_replaced);
  // Waits for the look that is under way, which ends by itself or by who interrupts the source.
  ~Follower();
  // Begins no look any more.
  void stop();
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

 private:
  enum class Trouble { kNone, kUnread, kDamaged, kReplaced };

  void run();
  bool wait();
  bool look();
  bool take_snapshot();
  void tell_trouble(Trouble trouble, const Status& status) noexcept;
  void tell_stall(double now) noexcept;

  SegmentStore& store_;
  const std::shared_ptr<RangeSource> source_;
  const LiveSettings settings_;
  const ReadLimits limits_;
  std::pmr::memory_resource* const memory_;
  const std::function<void(bool, const std::string&)> on_replaced_;

  // The thread's own.
  IndexCache cache_;
  std::shared_ptr<const SceneReader> reader_;
  PollInterval pace_;
  Trouble trouble_ = Trouble::kNone;
  bool stall_told_ = false, again_ = false;

  std::mutex mutex_;
  std::condition_variable stopped_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace stgs::player
