// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/player.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <limits>
#include <stop_token>
#include <utility>

#include "stream/follower.h"
#include "stream/live_edge.h"
#include "stream/playback_clock.h"
#include "stream/segment_store.h"
#include "stream/stream_timeline.h"
#include "stream/transfer_events.h"

namespace stgs::player {
namespace {

Status check(const PlayerSettings& s) {
  const auto is_valid = [](double v) { return std::isfinite(v) && v >= 0; };
  const LiveSettings& live = s.live;
  if (s.max_reads_in_flight < 1 || s.max_reads_in_flight > 64 || !is_valid(s.prefetch_seconds) ||
      !is_valid(s.resume_seconds) || !is_valid(s.layer_lead_seconds) ||
      !is_valid(s.retry_seconds) || !is_valid(live.latency_seconds) ||
      !is_valid(live.poll_seconds) || !is_valid(live.stall_seconds) ||
      !is_valid(live.skip_seconds)) {
    return usage_error(
        "player settings out of range (expected finite times of 0 s or more, and 1 to 64 reads in "
        "flight)");
  }
  return {};
}

std::string replaced_message(const std::string& name) {
  return fmt::format("{}: the file was overwritten or truncated; open it again", name);
}

class StreamPlayer final : public Player {
 public:
  StreamPlayer(const std::shared_ptr<const SceneReader>& reader,
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
  ~StreamPlayer() override {
    store_.stop();
    if (follower_ != nullptr) follower_->stop();
    if (interrupt_) interrupt_();
  }

  Timeline& timeline() override { return *timeline_; }

  void play() override {
    if (playing_) return;
    if (growing_ && following_) seek_to_edge_ = true;
    if (clock_.at_end()) {
      clock_.seek(clock_.rate() > 0 ? 0 : growing_ ? frames_ - 1.0 : frames_);
      update_playhead(true);
    }
    playing_ = true;
    state_ = PlayerState::kBuffering;
  }
  void pause() override {
    if (playing_) following_ = false;
    playing_ = false;
    state_ = PlayerState::kPaused;
    update_playhead(false);
  }
  Status seek(double seconds) override {
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
  Status seek_frame(std::uint32_t frame) override {
    if (frame >= frames_) {
      return usage_error("frame {} does not exist (the clip has {} frame{})", frame, frames_,
                         frames_ == 1 ? "" : "s");
    }
    following_ = false;
    go_to(frame);
    return {};
  }
  Status set_rate(double rate) override {
    if (!(rate >= kMinRate && rate <= kMaxRate) || rate == 0) {
      return usage_error("a rate must be {} to {} and not 0, got {}", kMinRate, kMaxRate, rate);
    }
    clock_.set_rate(rate);
    if (rate != 1) following_ = false;
    update_playhead(false);
    return {};
  }
  void set_loop(bool loop) override {
    loop_ = loop;
    clock_.set_loop(loop && !growing_);
    update_playhead(false);
  }
  void go_live() override {
    if (!growing_) return;
    follow();
    seek_to_edge_ = true;
    if (state_ == PlayerState::kEnded) state_ = PlayerState::kPaused;
  }
  LiveState live() const override {
    LiveState out;
    if (!growing_) return out;
    out.growing = true;
    out.following = following_;
    out.edge_seconds = time_base_.seconds(frames_);
    out.latency_seconds = edge_.edge(now_) - seconds();
    out.target_latency_seconds = edge_.target_latency();
    return out;
  }

  double advance(double now) override {
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

  PlayerState state() const override { return state_; }
  double seconds() const override { return time_base_.seconds(clock_.ticks()); }
  bool ready() const override { return layers() > 0; }
  int layers() const override { return store_.layers(clock_.ticks()); }
  int layer_count() const override { return 2 * store_.tiers(); }
  bool is_complete() const override { return store_.is_complete(clock_.ticks()); }
  std::vector<TimeRange> buffered() const override {
    std::vector<TimeRange> out;
    for (const TickRange& range : store_.ready_ranges()) {
      out.push_back({time_base_.seconds(range.begin), time_base_.seconds(range.end)});
    }
    return out;
  }
  StreamStatistics statistics() const override { return store_.statistics(); }
  std::vector<PlayerEvent> take_events() override {
    for (PlayerEvent& event : transfers_->take()) store_.push_event(std::move(event));
    return store_.take_events();
  }

 private:
  void push_event(PlayerEvent::Kind kind) {
    PlayerEvent event;
    event.kind = kind;
    store_.push_event(std::move(event));
  }

  // Reports a stall once, until playback resumes.
  void report_stall() {
    if (!std::exchange(stall_reported_, true)) push_event(PlayerEvent::Kind::kBuffering);
  }

  void go_to(double ticks) {
    clock_.seek(ticks);
    if (state_ == PlayerState::kEnded) state_ = PlayerState::kPaused;
    if (playing_) state_ = PlayerState::kBuffering;
    update_playhead(true);
  }

  void update_playhead(bool jumped) {
    Playhead playhead;
    playhead.ticks = clock_.ticks();
    playhead.ticks_per_second = clock_.ticks_per_second();
    playhead.duration = frames_;
    playhead.loop = clock_.loop();
    playhead.stationary = state_ != PlayerState::kPlaying;
    store_.set_playhead(playhead, jumped);
  }

  // Returns whether the next PlayerSettings::resume_seconds are available.
  bool can_resume() const {
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

  // Returns the beginning of the last frame known at present.
  double last_tick() const { return frames_ > 0 ? frames_ - 1.0 : 0.0; }
  bool is_growing() const { return reader_->form() == SceneForm::kGrowing; }
  // Returns the time from the beginning of the last part to the edge.
  static double last_fragment_seconds(const SceneReader& reader) {
    const TimeBase base = reader.metadata().time_base;
    if (reader.segments().empty()) return 0;
    return base.seconds(reader.metadata().frames - reader.parts().back().begin_ticks);
  }

  void begin_live(const std::shared_ptr<RangeSource>& source, IndexCache cache) {
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

  void follow() {
    clock_.set_rate(1);
    following_ = true;
  }

  // Updates the live edge. While playback follows it, a new edge counts once it is playable, or
  // after the duration of a fragment; otherwise it counts at once. `passed`: seconds since the last
  // call.
  void update_live_edge(double passed) {
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

  // Returns the factor of the rate for following the edge. Jumps if catching up would take too
  // long.
  double live_rate_factor() {
    const double time = seconds();
    if (!following_ && clock_.rate() > 0 && time >= edge_.target(now_)) follow();
    if (!following_) return 1;
    if (!edge_.should_skip(time, now_)) return edge_.rate_factor(time, now_);
    go_to(time_base_.ticks(std::max(edge_.target(now_), 0.0)));
    push_event(PlayerEvent::Kind::kSkipped);
    return 1;
  }

  // Returns whether the base layer at `ticks` is available or will not arrive.
  bool can_display(double ticks) const {
    return store_.ready(ticks) && !(growing_ && ticks >= frames_);
  }

  void step(double passed) {
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

Result<std::unique_ptr<Player>> make_player(std::unique_ptr<ByteSource> source,
                                            const PlayerSettings& settings,
                                            std::function<void()> interrupt,
                                            std::shared_ptr<TransferEvents> transfers) {
  std::pmr::memory_resource* const memory =
      settings.memory != nullptr ? settings.memory.get() : std::pmr::get_default_resource();
  const auto ranges = std::make_shared<RangeSource>(std::move(source), memory);
  try {
    if (ranges->size() > settings.max_file_bytes) {
      return Status(StatusCode::kLimit,
                    fmt::format("{}: the file is too large ({} bytes, the limit is {})",
                                ranges->name(), ranges->size(), settings.max_file_bytes));
    }
    IndexCache cache;
    STGS_ASSIGN(const auto reader, open_snapshot(ranges, cache, settings.limits, memory));
    // A truncated file may still be being written.
    const bool is_final = reader->form() != SceneForm::kGrowing && reader->damage().empty();
    if (is_final) ranges->set_finished();
    return std::unique_ptr<Player>(std::make_unique<StreamPlayer>(
        reader, ranges, std::move(cache), settings, std::move(interrupt), std::move(transfers)));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: cannot play: {}", ranges->name(), e.what()));
  }
}

}  // namespace

Result<std::unique_ptr<Player>> Player::open(const std::string& location,
                                             const PlayerSettings& settings) {
  STGS_TRY(check(settings));
  const auto transfers = std::make_shared<TransferEvents>(settings.on_opening_event);
  std::stop_source stop;
  // The stop token of the settings also stops the player's transfers.
  const auto linked = std::make_shared<std::stop_callback<std::function<void()>>>(
      settings.http.stop, [stop]() mutable { stop.request_stop(); });
  HttpSettings http = settings.http;
  http.max_connections =
      std::max(http.max_connections, settings.max_reads_in_flight + 1);  // one polls for growth
  http.stop = stop.get_token();
  http.on_event = [transfers, forward = settings.http.on_event](const TransferEvent& event) {
    transfers->add(event);
    if (forward) forward(event);
  };
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_location(location, http));
  auto player = make_player(
      std::move(source), settings, [stop, linked]() mutable { stop.request_stop(); }, transfers);
  transfers->opened();
  return player;
}

Result<std::unique_ptr<Player>> Player::from_source(std::unique_ptr<ByteSource> source,
                                                    const PlayerSettings& settings,
                                                    std::function<void()> interrupt) {
  STGS_TRY(check(settings));
  return make_player(std::move(source), settings, std::move(interrupt),
                     std::make_shared<TransferEvents>());
}

}  // namespace stgs::player
