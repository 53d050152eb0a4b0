// SPDX-License-Identifier: Apache-2.0
// The state machine of playback: the requests of the viewer against the available data.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "stgs/format/status.h"
#include "stgs/player/player.h"
#include "stream/availability.h"
#include "stream/live_edge.h"
#include "stream/need.h"
#include "stream/playback_clock.h"

namespace stgs::player {

enum class PlayState {
  kPaused,
  kPausedInStall,  // paused while stalled: a stall was reported, and its end was not
  kStarting,       // waits for data; not reported yet
  kPlaying,
  kStalled,  // waits for data; reported
  kEnded
};

// How playback relates to the live edge of a growing recording.
enum class FollowState {
  kNone,       // not a growing recording
  kDetached,   // somewhere before the edge
  kFollowing,  // at the target latency
  kJoining     // jumps to the target at the next step()
};

// Decides the position, the state and the events of playback. A value: it has neither threads nor
// I/O. Times named `now` are seconds of any one monotonic clock.
class Playback {
 public:
  // An event, with the position when it occurred, seconds.
  struct Event {
    PlayerEvent::Kind kind = PlayerEvent::Kind::kBuffering;
    double seconds = 0;
  };
  // The effects of a call, in order of occurrence.
  struct Effects {
    std::array<Event, 8> events;
    std::size_t event_count = 0;
    std::optional<Playhead> playhead;  // set if it may have changed
    bool jumped = false;               // the position did not result from playback
  };

  // `live`: the recording is followed while it grows, and playback begins at its edge.
  Playback(const PlayerSettings& settings, TimeBase time_base, const ClipExtent& extent, bool live);

  // Player documents these. Effects wait for take_effects().
  void play();
  void pause();
  Status seek(double seconds);
  Status seek_frame(std::uint32_t frame);
  Status set_rate(double rate);
  void set_loop(bool loop);
  void go_live();
  // Sets LiveSettings::latency_seconds. While it follows the live edge, playback converges to the
  // new latency. kUsage unless it is finite and not negative.
  Status set_live_latency(double seconds);
  // Advances to `now`, which must be finite.
  void step(double now, const Availability& data);
  // Returns the effects since the last call.
  Effects take_effects() noexcept;

  PlayState play_state() const { return play_; }
  FollowState follow_state() const { return follow_; }
  PlayerState state() const;
  LiveState live() const;
  double ticks() const { return clock_.ticks(); }
  double seconds() const { return time_base_.seconds(clock_.ticks()); }

 private:
  bool is_growing() const { return follow_ != FollowState::kNone; }
  bool is_following() const {
    return follow_ == FollowState::kFollowing || follow_ == FollowState::kJoining;
  }
  bool is_waiting() const { return play_ == PlayState::kStarting || play_ == PlayState::kStalled; }
  bool wants_to_play() const { return is_waiting() || play_ == PlayState::kPlaying; }
  // Returns the beginning of the last frame known at present.
  double last_tick() const { return extent_.frames > 0 ? extent_.frames - 1.0 : 0.0; }
  double now() const { return last_now_.value_or(0.0); }

  void push_event(PlayerEvent::Kind kind) noexcept;
  void update_playhead(bool jumped);
  void go_to(double ticks);
  void go_to_edge();
  void detach();
  void stall();
  void update_extent(double passed, const Availability& data);
  void close();
  double follow_edge();
  bool can_resume(const Availability& data) const;
  void play_on(double passed, const Availability& data);

  const double resume_seconds_;
  const TimeBase time_base_;
  ClipExtent extent_;
  PlaybackClock clock_;
  LiveEdge edge_;
  PlayState play_ = PlayState::kPaused;
  FollowState follow_ = FollowState::kNone;
  bool loop_ = false;  // takes effect once the duration is final
  std::optional<double> last_now_;
  double last_growth_ = 0;
  Effects effects_;
};

}  // namespace stgs::player
