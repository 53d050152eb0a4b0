// SPDX-License-Identifier: Apache-2.0
// Plays a scene from a stream: the implementation of Player.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stgs/player/player.h"
#include "stream/follower.h"
#include "stream/live_edge.h"
#include "stream/playback_clock.h"
#include "stream/segment_store.h"
#include "stream/transfer_events.h"

namespace stgs::player {

// Player documents the public functions.
class StreamPlayer {
 public:
  // `cache` is the one with which `reader` was opened. `interrupt` may be empty.
  StreamPlayer(const std::shared_ptr<const SceneReader>& reader,
               const std::shared_ptr<RangeSource>& source, IndexCache cache,
               const PlayerSettings& settings, std::function<void()> interrupt,
               std::shared_ptr<TransferEvents> transfers);
  ~StreamPlayer();
  StreamPlayer(const StreamPlayer&) = delete;
  StreamPlayer& operator=(const StreamPlayer&) = delete;

  Timeline& timeline() { return *timeline_; }
  void play();
  void pause();
  Status seek(double seconds);
  Status seek_frame(std::uint32_t frame);
  Status set_rate(double rate);
  void set_loop(bool loop);
  void go_live();
  LiveState live() const;
  double advance(double now);
  PlayerState state() const { return state_; }
  double seconds() const { return time_base_.seconds(clock_.ticks()); }
  bool ready() const { return layers() > 0; }
  int layers() const { return store_.layers(clock_.ticks()); }
  int layer_count() const { return 2 * store_.tiers(); }
  bool is_complete() const { return store_.is_complete(clock_.ticks()); }
  std::vector<TimeRange> buffered() const;
  StreamStatistics statistics() const { return store_.statistics(); }
  std::vector<PlayerEvent> take_events();

 private:
  void push_event(PlayerEvent::Kind kind);
  // Reports a stall once, until playback resumes.
  void report_stall();
  void go_to(double ticks);
  void update_playhead(bool jumped);
  // Returns whether the next PlayerSettings::resume_seconds are available.
  bool can_resume() const;
  // Returns the beginning of the last frame known at present.
  double last_tick() const { return frames_ > 0 ? frames_ - 1.0 : 0.0; }
  bool is_growing() const { return reader_->form() == SceneForm::kGrowing; }
  // Returns the time from the beginning of the last part to the edge.
  static double last_fragment_seconds(const SceneReader& reader);
  void begin_live(const std::shared_ptr<RangeSource>& source, IndexCache cache);
  void follow();
  // Updates the live edge. While playback follows it, a new edge counts once it is playable, or
  // after the duration of a fragment; otherwise it counts at once. `passed`: seconds since the last
  // call.
  void update_live_edge(double passed);
  // Returns the factor of the rate for following the edge. Jumps if catching up would take too
  // long.
  double live_rate_factor();
  // Returns whether the base layer at `ticks` is available or will not arrive.
  bool can_display(double ticks) const;
  void step(double passed);

  const PlayerSettings settings_;
  std::function<void()> interrupt_;
  const std::shared_ptr<TransferEvents> transfers_;
  const TimeBase time_base_;
  std::shared_ptr<const SceneReader> reader_;
  std::uint32_t frames_;
  PlaybackClock clock_;
  // Live playback of a growing recording.
  bool growing_ = false, following_ = false, seek_to_edge_ = false, loop_ = false;
  double last_growth_ = 0;  // on the caller's clock
  LiveEdge edge_;
  PlayerState state_ = PlayerState::kPaused;
  bool playing_ = false, started_ = false, stall_reported_ = false;
  double now_ = 0;
  int layers_ = -1;
  SegmentStore store_;
  std::unique_ptr<Timeline> timeline_;
  std::unique_ptr<Follower> follower_;
};

}  // namespace stgs::player
