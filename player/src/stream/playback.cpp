// SPDX-License-Identifier: Apache-2.0
#include "stream/playback.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace stgs::player {
namespace {

double fragment_seconds(const ClipExtent& extent, TimeBase time_base) {
  return time_base.seconds(extent.frames - extent.last_fragment_begin);
}

}  // namespace

Playback::Playback(const PlayerSettings& settings, TimeBase time_base, const ClipExtent& extent,
                   bool live)
    : resume_seconds_(settings.resume_seconds),
      time_base_(time_base),
      extent_(extent),
      clock_(last_tick(), time_base.ticks(1.0)),
      edge_(settings.live, time_base.seconds(extent.frames), fragment_seconds(extent, time_base)) {
  if (live) {
    follow_ = FollowState::kJoining;
    clock_.set_last(std::numeric_limits<double>::infinity());
    const double time = time_base.seconds(extent.frames) - edge_.target_latency();
    clock_.seek(std::max(time_base.ticks(time), 0.0));
  }
  update_playhead(true);
}

Playback::Effects Playback::take_effects() noexcept {
  Effects out;
  std::swap(out, effects_);
  return out;
}

PlayerState Playback::state() const {
  switch (play_) {
    case PlayState::kPaused:
    case PlayState::kPausedInStall:
      return PlayerState::kPaused;
    case PlayState::kStarting:
    case PlayState::kStalled:
      return PlayerState::kBuffering;
    case PlayState::kPlaying:
      return PlayerState::kPlaying;
    case PlayState::kEnded:
      break;
  }
  return PlayerState::kEnded;
}

LiveState Playback::live() const {
  LiveState out;
  if (!is_growing()) return out;
  out.growing = true;
  out.following = is_following();
  out.edge_seconds = time_base_.seconds(extent_.frames);
  out.latency_seconds = edge_.edge(now()) - seconds();
  out.target_latency_seconds = edge_.target_latency();
  return out;
}

void Playback::play() {
  if (wants_to_play()) return;
  if (is_following()) follow_ = FollowState::kJoining;
  if (clock_.at_end()) {
    const double end = extent_.frames;
    clock_.seek(clock_.rate() > 0 ? 0 : is_growing() ? end - 1 : end);
    update_playhead(true);
  }
  play_ = play_ == PlayState::kPausedInStall ? PlayState::kStalled : PlayState::kStarting;
}

void Playback::pause() {
  if (wants_to_play()) {
    detach();
    play_ = play_ == PlayState::kStalled ? PlayState::kPausedInStall : PlayState::kPaused;
  } else if (play_ == PlayState::kEnded) {
    play_ = PlayState::kPaused;
  }
  update_playhead(false);
}

Status Playback::seek(double seconds) {
  if (!std::isfinite(seconds)) {
    return usage_error("a time must be a finite number of seconds, got {}", seconds);
  }
  if (is_growing() && seconds >= edge_.target(now())) {
    go_live();
    return {};
  }
  detach();
  go_to(time_base_.ticks(seconds));
  return {};
}

Status Playback::seek_frame(std::uint32_t frame) {
  if (frame >= extent_.frames) {
    return usage_error("frame {} does not exist (the clip has {} frame{})", frame, extent_.frames,
                       extent_.frames == 1 ? "" : "s");
  }
  detach();
  go_to(frame);
  return {};
}

Status Playback::set_rate(double rate) {
  if (!(rate >= kMinRate && rate <= kMaxRate) || rate == 0) {
    return usage_error("a rate must be {} to {} and not 0, got {}", kMinRate, kMaxRate, rate);
  }
  clock_.set_rate(rate);
  if (rate != 1) detach();
  update_playhead(false);
  return {};
}

void Playback::set_loop(bool loop) {
  loop_ = loop;
  clock_.set_loop(loop && !is_growing());
  update_playhead(false);
}

void Playback::go_live() {
  if (!is_growing()) return;
  clock_.set_rate(1);
  follow_ = FollowState::kJoining;
  if (play_ == PlayState::kEnded) play_ = PlayState::kPaused;
}

Status Playback::set_live_latency(double seconds) {
  if (!(std::isfinite(seconds) && seconds >= 0)) {
    return usage_error("a latency must be a finite number of seconds, at least 0, got {}", seconds);
  }
  edge_.set_latency(seconds);
  return {};
}

void Playback::step(double now, const Availability& data) {
  const double since = last_now_ ? now - *last_now_ : 0.0;
  last_now_ = now;
  if (is_growing()) update_extent(since, data);
  if (follow_ == FollowState::kJoining) {
    go_to_edge();
    follow_ = FollowState::kFollowing;
  }
  if (wants_to_play()) play_on(std::clamp(since, 0.0, kMaxStepSeconds), data);
}

void Playback::push_event(PlayerEvent::Kind kind) noexcept {
  // Full only if exceptions have interrupted several steps.
  if (effects_.event_count == effects_.events.size()) return;
  effects_.events[effects_.event_count++] = {kind, seconds()};
}

void Playback::update_playhead(bool jumped) {
  Playhead playhead;
  playhead.ticks = clock_.ticks();
  playhead.ticks_per_second = clock_.ticks_per_second();
  playhead.duration = extent_.frames;
  playhead.loop = clock_.loop();
  playhead.stationary = play_ != PlayState::kPlaying;
  effects_.playhead = playhead;
  effects_.jumped |= jumped;
}

void Playback::go_to(double ticks) {
  clock_.seek(ticks);
  if (play_ == PlayState::kEnded) play_ = PlayState::kPaused;
  if (play_ == PlayState::kPlaying) play_ = PlayState::kStarting;
  update_playhead(true);
}

void Playback::go_to_edge() {
  go_to(time_base_.ticks(std::max(edge_.target(now()), 0.0)));
}

// Ends following.
void Playback::detach() {
  if (is_growing()) follow_ = FollowState::kDetached;
}

// Waits for data. A stall is reported once, until playback resumes.
void Playback::stall() {
  if (play_ != PlayState::kStalled) push_event(PlayerEvent::Kind::kBuffering);
  play_ = PlayState::kStalled;
}

// Updates the live edge. While playback follows it, a new edge counts once it is playable, or after
// the duration of a fragment; otherwise it counts at once. `passed`: seconds since the last step.
void Playback::update_extent(double passed, const Availability& data) {
  if (const ClipExtent extent = data.extent(); extent.file_bytes != extent_.file_bytes) {
    extent_ = extent;
    last_growth_ = now();
  }
  const double fragment = fragment_seconds(extent_, time_base_);
  const double edge = time_base_.seconds(extent_.frames);
  const bool counts = !is_following() || !wants_to_play() || data.ready(last_tick());
  if (passed > kMaxStepSeconds || (!counts && now() - last_growth_ > fragment)) {
    edge_.extend_to(edge);
  } else if (counts) {
    edge_.observe(edge, fragment, now());
  }
  if (!extent_.growing) close();
}

// The recording was closed: from now on it is a clip like any other.
void Playback::close() {
  follow_ = FollowState::kNone;
  clock_.set_last(last_tick());
  clock_.set_loop(loop_);
  update_playhead(false);
  push_event(PlayerEvent::Kind::kFinished);
}

// Returns the factor of the rate for following the edge. Jumps if catching up would take too long.
double Playback::follow_edge() {
  const double time = seconds();
  if (follow_ == FollowState::kDetached && clock_.rate() > 0 && time >= edge_.target(now())) {
    clock_.set_rate(1);
    follow_ = FollowState::kFollowing;
  }
  if (follow_ != FollowState::kFollowing) return 1;
  if (!edge_.should_skip(time, now())) return edge_.rate_factor(time, now());
  go_to_edge();
  push_event(PlayerEvent::Kind::kSkipped);
  return 1;
}

// Returns whether the next PlayerSettings::resume_seconds are available.
bool Playback::can_resume(const Availability& data) const {
  const double at = clock_.ticks(), end = extent_.frames;
  const PlaybackClock::Step ahead = clock_.after(resume_seconds_);
  const std::vector<TickRange> ranges = data.ready_ranges();
  const auto covered = [&](double from, double to) {
    return std::any_of(ranges.begin(), ranges.end(), [&](const TickRange& range) {
      return range.begin <= std::min(from, to) && std::max(from, to) <= range.end;
    });
  };
  // At the ends of a range, ready() also checks the adjacent segments.
  if (!data.ready(at) || !data.ready(ahead.ticks)) return false;
  if (!ahead.looped) return covered(at, ahead.ticks);
  return clock_.rate() > 0 ? covered(at, end) && covered(0, ahead.ticks)
                           : covered(0, at) && covered(ahead.ticks, end);
}

void Playback::play_on(double passed, const Availability& data) {
  const double rate_factor = is_growing() ? follow_edge() : 1;
  if (is_waiting()) {
    if (!can_resume(data)) return stall();
    const bool was_reported = play_ == PlayState::kStalled;
    play_ = PlayState::kPlaying;
    update_playhead(false);
    if (was_reported) push_event(PlayerEvent::Kind::kResumed);
  }
  const PlaybackClock::Step next = clock_.after(rate_factor * passed);
  const bool is_past_edge = is_growing() && next.ticks >= extent_.frames;
  if (is_past_edge || !data.ready(next.ticks)) {
    stall();
    return update_playhead(false);
  }
  clock_.apply(next);
  if (next.ended) play_ = PlayState::kEnded;
  update_playhead(false);
  if (next.looped) push_event(PlayerEvent::Kind::kLooped);
  if (next.ended) push_event(PlayerEvent::Kind::kEnded);
}

}  // namespace stgs::player
