// SPDX-License-Identifier: Apache-2.0
// Reads the index of a file as playback needs it, and polls a growing recording.
#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <limits>
#include <memory>
#include <memory_resource>

#include "stgs/player/player.h"
#include "stream/poll_interval.h"
#include "stream/segment_store.h"
#include "stream/snapshot_source.h"

namespace stgs::player {

// Passes readers that know more of the file to the segment store. step() does the work; one thread
// at a time may call it. Reports each problem once, and again if it recurs after successful
// attempts; keeps trying in any case.
class Follower {
 public:
  // `cache` is the one with which the reader of `store` was opened. `polls`: whether to follow the
  // recording. Everything else outlives this object. `on_replaced` receives true and a message if
  // the file was replaced, and false once it is the right one again.
  Follower(SegmentStore& store, std::shared_ptr<RangeSource> source, IndexCache cache,
           const PlayerSettings& settings, bool polls,
           std::function<void(bool, const std::string&)> on_replaced);
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

  // Loads the parts of the index that playback needs, and polls the recording if that is due. Waits
  // for reads, unless the source cannot (ByteSource::is_pending()): then it does nothing until the
  // bytes have arrived. Returns the time of the next call, clock seconds; infinity: call it when
  // playback needs another part of the index, or bytes have arrived.
  double step() noexcept;
  // Returns whether the file is complete and its index is known.
  bool is_done() const { return !is_polling() && reader_->is_loaded(-kNever, kNever); }
  // Starts no further reads, even for a load in progress. Thread-safe.
  void stop() noexcept;

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();
  enum class Problem {
    kNone,
    kUnreadable,
    kDamaged,  // the file is invalid
    kReplaced  // the file was replaced or truncated
  };

  bool is_polling() const { return polls_ && reader_->form() == SceneForm::kGrowing; }
  double next_poll() const { return polled_at_ + interval_.seconds(); }
  Status failure_of(const std::exception& e) const noexcept;
  void load() noexcept;
  Status load_next(bool& loaded);
  void poll_once() noexcept;
  bool poll();
  bool has_news();
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

  IndexCache cache_;
  std::shared_ptr<const SceneReader> reader_;
  PollInterval interval_;
  double polled_at_ = 0;
  Problem problem_ = Problem::kNone;
  bool load_failed_ = false;
  double retry_at_ = 0;          // if loading failed
  bool is_overwritten_ = false;  // found while loading; reported by `on_replaced_`
  bool stall_reported_ = false;
  bool retry_ = false;       // read the file again even if its size is unchanged
  bool is_reading_ = false;  // a poll waits for bytes of the file
  std::atomic<bool> stopping_ = false;
};

}  // namespace stgs::player
