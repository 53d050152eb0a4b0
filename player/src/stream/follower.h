// SPDX-License-Identifier: Apache-2.0
// Reads the index of a file as playback needs it, and polls a growing recording.
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

// Hands readers that know more of the file to the segment store. Runs a thread that ends when the
// file is complete and its index is known, or with this object. Reports each problem once, and
// again if it recurs after attempts without one; keeps trying in any case.
class Follower {
 public:
  // `cache` is the one with which the reader of `store` was opened. `polls`: whether to follow the
  // recording. Everything else outlives this object. `on_replaced` receives true and a message if
  // the file was replaced, and false once it is the right one again.
  Follower(SegmentStore& store, std::shared_ptr<RangeSource> source, IndexCache cache,
           const PlayerSettings& settings, bool polls,
           std::function<void(bool, const std::string&)> on_replaced);
  // Waits for a read in progress, which ends by itself or when its source is interrupted.
  ~Follower();
  // Begins no further reads, also of a load in progress.
  void stop();
  // Looks at once for parts of the index that playback needs. Thread-safe.
  void wake() noexcept;
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
  bool is_polling() const { return polls_ && reader_->form() == SceneForm::kGrowing; }
  bool wait();
  void load() noexcept;
  Status load_next(bool& loaded);
  void poll_once() noexcept;
  bool poll();
  bool take_snapshot();
  Result<std::shared_ptr<const SceneReader>> read_snapshot();
  void set_problem(Problem problem, const Status& status) noexcept;
  void report_stall(double now) noexcept;

  SegmentStore& store_;
  const std::shared_ptr<RangeSource> source_;
  const LiveSettings settings_;
  const double retry_seconds_;
  const bool polls_;
  const ReadLimits limits_;
  std::pmr::memory_resource* const memory_;
  const std::function<void(bool, const std::string&)> on_replaced_;

  // Used by the thread only.
  IndexCache cache_;
  std::shared_ptr<const SceneReader> reader_;
  PollInterval interval_;
  double polled_at_ = 0;
  Problem problem_ = Problem::kNone;
  bool load_failed_ = false;
  bool is_overwritten_ = false;  // found while loading; reported by `on_replaced_`
  bool stall_reported_ = false;
  bool retry_ = false;  // read the file again even if its size is unchanged

  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopping_ = false, woken_ = false;
  std::thread thread_;
};

}  // namespace stgs::player
