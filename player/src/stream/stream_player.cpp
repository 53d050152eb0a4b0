// SPDX-License-Identifier: Apache-2.0
#include "stream/stream_player.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "stream/stream_timeline.h"

namespace stgs::player {
namespace {

std::string replaced_message(const std::string& name) {
  return fmt::format("{}: the file was overwritten or truncated; open it again", name);
}

}  // namespace

StreamPlayer::StreamPlayer(const std::shared_ptr<const SceneReader>& reader,
                           const std::shared_ptr<RangeSource>& source, IndexCache cache,
                           const PlayerSettings& settings, std::function<void()> interrupt,
                           std::shared_ptr<TransferEvents> transfers)
    : settings_(settings),
      interrupt_(std::move(interrupt)),
      transfers_(std::move(transfers)),
      time_base_(reader->metadata().time_base),
      reader_(reader),
      frames_(reader->metadata().frames),
      clock_(last_tick(), time_base_.ticks(1.0)),
      edge_(settings.live, time_base_.seconds(frames_), last_fragment_seconds(*reader)),
      store_(reader, source, settings,
             [transfers = transfers_, message = replaced_message(source->name())](bool changed) {
               transfers->set_replaced(changed, message);
             }),
      timeline_(make_stream_timeline(store_, source->name())) {
  growing_ = settings.live.follow && source->may_grow() && is_growing();
  // Nothing is fetched before the first update_playhead(), so that a failure until then does not
  // wait for a read.
  if (growing_) begin_live(source, std::move(cache));
  update_playhead(true);
}

StreamPlayer::~StreamPlayer() {
  store_.stop();
  if (follower_ != nullptr) follower_->stop();
  if (interrupt_) interrupt_();
}

void StreamPlayer::play() {
  if (playing_) return;
  if (growing_ && following_) seek_to_edge_ = true;
  if (clock_.at_end()) {
    clock_.seek(clock_.rate() > 0 ? 0 : growing_ ? frames_ - 1.0 : frames_);
    update_playhead(true);
  }
  playing_ = true;
  state_ = PlayerState::kBuffering;
}

void StreamPlayer::pause() {
  if (playing_) following_ = false;
  playing_ = false;
  state_ = PlayerState::kPaused;
  update_playhead(false);
}

Status StreamPlayer::seek(double seconds) {
  if (!std::isfinite(seconds)) {
    return usage_error("a time must be a finite number of seconds, got {}", seconds);
  }
  if (growing_ && seconds >= edge_.target(now_)) {
    go_live();
    return {};
  }
  following_ = false;
  go_to(time_base_.ticks(seconds));
  return {};
}

Status StreamPlayer::seek_frame(std::uint32_t frame) {
  if (frame >= frames_) {
    return usage_error("frame {} does not exist (the clip has {} frame{})", frame, frames_,
                       frames_ == 1 ? "" : "s");
  }
  following_ = false;
  go_to(frame);
  return {};
}

Status StreamPlayer::set_rate(double rate) {
  if (!(rate >= kMinRate && rate <= kMaxRate) || rate == 0) {
    return usage_error("a rate must be {} to {} and not 0, got {}", kMinRate, kMaxRate, rate);
  }
  clock_.set_rate(rate);
  if (rate != 1) following_ = false;
  update_playhead(false);
  return {};
}

void StreamPlayer::set_loop(bool loop) {
  loop_ = loop;
  clock_.set_loop(loop && !growing_);
  update_playhead(false);
}

void StreamPlayer::go_live() {
  if (!growing_) return;
  follow();
  seek_to_edge_ = true;
  if (state_ == PlayerState::kEnded) state_ = PlayerState::kPaused;
}

LiveState StreamPlayer::live() const {
  LiveState out;
  if (!growing_) return out;
  out.growing = true;
  out.following = following_;
  out.edge_seconds = time_base_.seconds(frames_);
  out.latency_seconds = edge_.edge(now_) - seconds();
  out.target_latency_seconds = edge_.target_latency();
  return out;
}

double StreamPlayer::advance(double now) {
  if (!std::isfinite(now)) return seconds();
  const double since = started_ ? now - now_ : 0.0;
  const double passed = std::clamp(since, 0.0, kMaxStepSeconds);
  now_ = now;
  if (growing_) update_live_edge(since);
  if (growing_ && seek_to_edge_) go_to(time_base_.ticks(std::max(edge_.target(now_), 0.0)));
  seek_to_edge_ = false;
  if (playing_) step(passed);
  started_ = true;
  if (const int layers = this->layers(); layers != layers_) {
    layers_ = layers;
    PlayerEvent event;
    event.kind = PlayerEvent::Kind::kLayers;
    event.layers = layers;
    store_.push_event(std::move(event));
  }
  return seconds();
}

std::vector<TimeRange> StreamPlayer::buffered() const {
  std::vector<TimeRange> out;
  for (const TickRange& range : store_.ready_ranges()) {
    out.push_back({time_base_.seconds(range.begin), time_base_.seconds(range.end)});
  }
  return out;
}

std::vector<PlayerEvent> StreamPlayer::take_events() {
  for (PlayerEvent& event : transfers_->take()) store_.push_event(std::move(event));
  return store_.take_events();
}

void StreamPlayer::push_event(PlayerEvent::Kind kind) {
  PlayerEvent event;
  event.kind = kind;
  store_.push_event(std::move(event));
}

void StreamPlayer::report_stall() {
  if (!std::exchange(stall_reported_, true)) push_event(PlayerEvent::Kind::kBuffering);
}

void StreamPlayer::go_to(double ticks) {
  clock_.seek(ticks);
  if (state_ == PlayerState::kEnded) state_ = PlayerState::kPaused;
  if (playing_) state_ = PlayerState::kBuffering;
  update_playhead(true);
}

void StreamPlayer::update_playhead(bool jumped) {
  Playhead playhead;
  playhead.ticks = clock_.ticks();
  playhead.ticks_per_second = clock_.ticks_per_second();
  playhead.duration = frames_;
  playhead.loop = clock_.loop();
  playhead.stationary = state_ != PlayerState::kPlaying;
  store_.set_playhead(playhead, jumped);
}

bool StreamPlayer::can_resume() const {
  const double at = clock_.ticks(), end = frames_;
  const PlaybackClock::Step ahead = clock_.after(settings_.resume_seconds);
  const std::vector<TickRange> ranges = store_.ready_ranges();
  const auto covered = [&](double from, double to) {
    return std::any_of(ranges.begin(), ranges.end(), [&](const TickRange& range) {
      return range.begin <= std::min(from, to) && std::max(from, to) <= range.end;
    });
  };
  // At the ends of a range, ready() also checks the adjacent segments.
  if (!store_.ready(at) || !store_.ready(ahead.ticks)) return false;
  if (!ahead.looped) return covered(at, ahead.ticks);
  return clock_.rate() > 0 ? covered(at, end) && covered(0, ahead.ticks)
                           : covered(0, at) && covered(ahead.ticks, end);
}

double StreamPlayer::last_fragment_seconds(const SceneReader& reader) {
  const TimeBase base = reader.metadata().time_base;
  if (reader.segments().empty()) return 0;
  return base.seconds(reader.metadata().frames - reader.parts().back().begin_ticks);
}

void StreamPlayer::begin_live(const std::shared_ptr<RangeSource>& source, IndexCache cache) {
  clock_.set_last(std::numeric_limits<double>::infinity());
  following_ = true;
  seek_to_edge_ = true;
  const double time = time_base_.seconds(frames_) - edge_.target_latency();
  clock_.seek(std::max(time_base_.ticks(time), 0.0));
  follower_ = std::make_unique<Follower>(
      store_, source, std::move(cache), settings_,
      [transfers = transfers_](bool replaced, const std::string& message) {
        transfers->set_replaced(replaced, message);
      });
}

void StreamPlayer::follow() {
  clock_.set_rate(1);
  following_ = true;
}

void StreamPlayer::update_live_edge(double passed) {
  if (SegmentStore::Snapshot now = store_.snapshot(); now.reader != reader_) {
    reader_ = std::move(now.reader);
    frames_ = reader_->metadata().frames;
    last_growth_ = now_;
  }
  const double last = last_tick(), fragment = last_fragment_seconds(*reader_);
  const double edge = time_base_.seconds(frames_);
  const bool counts = !following_ || !playing_ || store_.ready(last);
  if (passed > kMaxStepSeconds || (!counts && now_ - last_growth_ > fragment)) {
    edge_.extend_to(edge);
  } else if (counts) {
    edge_.observe(edge, fragment, now_);
  }
  if (is_growing()) return;
  growing_ = following_ = false;
  clock_.set_last(last);
  clock_.set_loop(loop_);
  update_playhead(false);
  push_event(PlayerEvent::Kind::kFinished);
}

double StreamPlayer::live_rate_factor() {
  const double time = seconds();
  if (!following_ && clock_.rate() > 0 && time >= edge_.target(now_)) follow();
  if (!following_) return 1;
  if (!edge_.should_skip(time, now_)) return edge_.rate_factor(time, now_);
  go_to(time_base_.ticks(std::max(edge_.target(now_), 0.0)));
  push_event(PlayerEvent::Kind::kSkipped);
  return 1;
}

bool StreamPlayer::can_display(double ticks) const {
  return store_.ready(ticks) && !(growing_ && ticks >= frames_);
}

void StreamPlayer::step(double passed) {
  const double rate_factor = growing_ ? live_rate_factor() : 1;
  if (state_ == PlayerState::kBuffering) {
    if (!can_resume()) return report_stall();
    state_ = PlayerState::kPlaying;
    update_playhead(false);
    if (std::exchange(stall_reported_, false)) push_event(PlayerEvent::Kind::kResumed);
  }
  if (state_ != PlayerState::kPlaying) return;
  const PlaybackClock::Step next = clock_.after(rate_factor * passed);
  if (!can_display(next.ticks)) {
    state_ = PlayerState::kBuffering;
    update_playhead(false);
    return report_stall();
  }
  clock_.apply(next);
  if (next.ended) {
    playing_ = false;
    state_ = PlayerState::kEnded;
  }
  update_playhead(false);
  if (next.looped) push_event(PlayerEvent::Kind::kLooped);
  if (next.ended) push_event(PlayerEvent::Kind::kEnded);
}

}  // namespace stgs::player
