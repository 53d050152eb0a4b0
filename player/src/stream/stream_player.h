// SPDX-License-Identifier: Apache-2.0
// Plays a scene from a stream: the implementation of Player.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stgs/format/budget.h"
#include "stgs/player/player.h"
#include "stream/async_byte_source.h"
#include "stream/decode_executor.h"
#include "stream/follow_thread.h"
#include "stream/follower.h"
#include "stream/playback.h"
#include "stream/pump_thread.h"
#include "stream/segment_store.h"
#include "stream/transfer_events.h"

namespace stgs::player {

// The file that a player plays.
struct OpenedFile {
  std::shared_ptr<const SceneReader> reader;
  std::shared_ptr<RangeSource> source;   // of `reader`
  IndexCache cache;                      // with which `reader` was opened
  std::function<void()> interrupt = {};  // makes pending reads of `source` fail; may be empty
  std::shared_ptr<TransferEvents> transfers = std::make_shared<TransferEvents>();
};

// Connects Playback, which decides, to SegmentStore, which provides the data. Player documents the
// public functions.
class StreamPlayer {
 public:
  // Reads, decodes and follows on threads.
  StreamPlayer(OpenedFile file, const PlayerSettings& settings, std::shared_ptr<Budget> budget);
  // Has no threads of its own: pump() does the work.
  StreamPlayer(OpenedFile file, const PlayerSettings& settings, std::shared_ptr<Budget> budget,
               std::unique_ptr<AsyncByteSource> transport,
               std::unique_ptr<DecodeExecutor> executor);
  ~StreamPlayer();
  StreamPlayer(const StreamPlayer&) = delete;
  StreamPlayer& operator=(const StreamPlayer&) = delete;

  // Follower::step() and SegmentStore::pump(), for a player without threads.
  PumpResult pump(double now, double budget) noexcept;

  // Returns the file, as far as known now.
  FileSnapshot snapshot() const { return store_.snapshot(); }

  Timeline& timeline() { return *timeline_; }
  void play();
  void pause();
  Status seek(double seconds);
  Status seek_frame(std::uint32_t frame);
  Status set_rate(double rate);
  void set_loop(bool loop);
  void go_live();
  // Playback documents this.
  Status set_live_latency(double seconds) { return playback_.set_live_latency(seconds); }
  LiveState live() const { return playback_.live(); }
  double advance(double now);
  PlayerState state() const { return playback_.state(); }
  double seconds() const { return playback_.seconds(); }
  bool ready() const { return layers() > 0; }
  int layers() const { return store_.layers(playback_.ticks()); }
  int layer_count() const { return 2 * store_.tiers(); }
  bool is_complete() const { return store_.is_complete(playback_.ticks()); }
  std::vector<TimeRange> buffered() const;
  // SegmentStore documents these.
  void limit_primitives(std::uint64_t max_primitives) { store_.limit_primitives(max_primitives); }
  std::vector<std::uint64_t> tier_peaks() const { return store_.tier_peaks(); }
  StreamStatistics statistics() const { return store_.statistics(); }
  std::vector<PlayerEvent> take_events();

 private:
  // Takes parts of `file`.
  StreamPlayer(const PlayerSettings& settings, OpenedFile& file, std::shared_ptr<Budget> budget,
               std::unique_ptr<AsyncByteSource> transport,
               std::unique_ptr<DecodeExecutor> executor);
  // Forwards the effects of the last calls of `playback_`.
  void apply_effects() noexcept;
  void report_layers();

  const std::function<void()> interrupt_;
  const std::shared_ptr<TransferEvents> transfers_;
  const TimeBase time_base_;
  Playback playback_;
  int layers_ = -1;                          // as reported
  std::unique_ptr<PumpThread> pump_thread_;  // before `store_`, whose threads call it
  SegmentStore store_;
  std::unique_ptr<Timeline> timeline_;
  std::unique_ptr<Follower> follower_;  // null if the file is complete and its index known
  std::unique_ptr<FollowThread> follow_thread_;
};

}  // namespace stgs::player
