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
  const auto positive = [](double v) { return std::isfinite(v) && v >= 0; };
  const LiveSettings& live = s.live;
  if (s.max_reads_in_flight < 1 || s.max_reads_in_flight > 64 || !positive(s.prefetch_seconds) ||
      !positive(s.resume_seconds) || !positive(s.layer_lead_seconds) ||
      !positive(s.retry_seconds) || !positive(live.latency_seconds) ||
      !positive(live.poll_seconds) || !positive(live.stall_seconds) ||
      !positive(live.skip_seconds)) {
    return usage_error(
        "the player's settings are out of range: times must be 0 s or more, and 1 "
        "to 64 pieces fetched at once");
  }
  return {};
}

std::string changed_message(const std::string& name) {
  return fmt::format("{}: is not what it was: it was overwritten or cut; open it again", name);
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
        known_(reader),
        frames_(reader->metadata().frames),
        clock_(last_moment(), time_base_.ticks(1.0)),
        edge_(settings.live, time_base_.seconds(frames_), last_stretch(*reader)),
        store_(reader, source, settings,
               [transfers = transfers_, message = changed_message(source->name())](bool changed) {
                 transfers->set_replaced(changed, message);
               }),
        timeline_(make_stream_timeline(store_, source->name())) {
    growing_ = settings.live.follow && source->may_grow() && is_growing();
    // Nothing is fetched before the first move, so that a failure here waits for no read.
    if (growing_) begin_live(source, std::move(cache));
    move(true);
  }
  ~StreamPlayer() override {
    store_.stop();
    if (follower_ != nullptr) follower_->stop();
    if (interrupt_) interrupt_();
  }

  Timeline& timeline() override { return *timeline_; }

  void play() override {
    if (playing_) return;
    if (growing_ && following_) to_edge_ = true;
    if (clock_.at_end()) {
      clock_.seek(clock_.rate() > 0 ? 0 : growing_ ? frames_ - 1.0 : frames_);
      move(true);
    }
    playing_ = true;
    state_ = PlayerState::kBuffering;
  }
  void pause() override {
    if (playing_) following_ = false;
    playing_ = false;
    state_ = PlayerState::kPaused;
    move(false);
  }
  Status seek(double seconds) override {
    if (!std::isfinite(seconds)) {
      return usage_error("a moment must be a number of seconds, not {}", seconds);
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
      return usage_error("no frame {}, the clip has {}", frame, frames_);
    }
    following_ = false;
    go_to(frame);
    return {};
  }
  Status set_rate(double rate) override {
    if (!(rate >= kMinRate && rate <= kMaxRate) || rate == 0) {
      return usage_error("a rate must be from {} to {}, and not 0: {}", kMinRate, kMaxRate, rate);
    }
    clock_.set_rate(rate);
    if (rate != 1) following_ = false;
    move(false);
    return {};
  }
  void set_loop(bool loop) override {
    loop_ = loop;
    clock_.set_loop(loop && !growing_);
    move(false);
  }
  void go_live() override {
    if (!growing_) return;
    follow();
    to_edge_ = true;
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
    if (growing_) note_growth(since);
    if (growing_ && to_edge_) go_to(time_base_.ticks(std::max(edge_.target(now_), 0.0)));
    to_edge_ = false;
    if (playing_) step(passed);
    started_ = true;
    if (const int layers = this->layers(); layers != layers_) {
      layers_ = layers;
      PlayerEvent event;
      event.kind = PlayerEvent::Kind::kLayers;
      event.layers = layers;
      store_.tell(std::move(event));
    }
    return seconds();
  }

  PlayerState state() const override { return state_; }
  double seconds() const override { return time_base_.seconds(clock_.ticks()); }
  bool ready() const override { return layers() > 0; }
  int layers() const override { return store_.layers(clock_.ticks()); }
  int layer_count() const override { return 2 * store_.tiers(); }
  bool is_complete() const override { return store_.settled(clock_.ticks()); }
  std::vector<TimeRange> buffered() const override {
    std::vector<TimeRange> out;
    for (const TickRange& range : store_.ready_ranges()) {
      out.push_back({time_base_.seconds(range.begin), time_base_.seconds(range.end)});
    }
    return out;
  }
  StreamStatistics statistics() const override { return store_.statistics(); }
  std::vector<PlayerEvent> take_events() override {
    for (PlayerEvent& event : transfers_->take()) store_.tell(std::move(event));
    return store_.take_events();
  }

 private:
  void tell(PlayerEvent::Kind kind) {
    PlayerEvent event;
    event.kind = kind;
    store_.tell(std::move(event));
  }

  // Once, until the moment goes on.
  void tell_standing() {
    if (!std::exchange(told_standing_, true)) tell(PlayerEvent::Kind::kBuffering);
  }

  void go_to(double ticks) {
    clock_.seek(ticks);
    if (state_ == PlayerState::kEnded) state_ = PlayerState::kPaused;
    if (playing_) state_ = PlayerState::kBuffering;
    move(true);
  }

  void move(bool jumped) {
    Playhead motion;
    motion.ticks = clock_.ticks();
    motion.ticks_per_second = clock_.ticks_per_second();
    motion.duration = frames_;
    motion.loop = clock_.loop();
    motion.still = state_ != PlayerState::kPlaying;
    store_.move(motion, jumped);
  }

  // Whether what is next has come, so far that play does not stop again at once.
  bool can_resume() const {
    const double at = clock_.ticks(), end = frames_;
    const PlaybackClock::Step ahead = clock_.after(settings_.resume_seconds);
    const std::vector<TickRange> ranges = store_.ready_ranges();
    const auto covered = [&](double from, double to) {
      return std::any_of(ranges.begin(), ranges.end(), [&](const TickRange& range) {
        return range.begin <= std::min(from, to) && std::max(from, to) <= range.end;
      });
    };
    // At the very ends of a range its neighbour counts too.
    if (!store_.ready(at) || !store_.ready(ahead.ticks)) return false;
    if (!ahead.looped) return covered(at, ahead.ticks);
    return clock_.rate() > 0 ? covered(at, end) && covered(0, ahead.ticks)
                             : covered(0, at) && covered(ahead.ticks, end);
  }

  // The beginning of the last frame; while a recording grows it has none.
  double last_moment() const { return frames_ > 0 ? frames_ - 1.0 : 0.0; }
  bool is_growing() const { return known_->form() == SceneForm::kGrowing; }
  // Seconds from the beginning of the part that began last to the edge.
  static double last_stretch(const SceneReader& reader) {
    const TimeBase base = reader.metadata().time_base;
    if (reader.segments().empty()) return 0;
    return base.seconds(reader.metadata().frames - reader.parts().back().begin_ticks);
  }

  void begin_live(const std::shared_ptr<RangeSource>& source, IndexCache cache) {
    clock_.set_last(std::numeric_limits<double>::infinity());
    following_ = true;
    to_edge_ = true;
    const double moment = time_base_.seconds(frames_) - edge_.target_latency();
    clock_.seek(std::max(time_base_.ticks(moment), 0.0));
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

  // The edge counts as soon as play could get there, or where that takes longer than a stretch; who
  // plays elsewhere takes it as it comes.
  // `passed`: since it was looked last.
  void note_growth(double passed) {
    if (SegmentStore::Known now = store_.known(); now.reader != known_) {
      known_ = std::move(now.reader);
      frames_ = known_->metadata().frames;
      grown_at_ = now_;
    }
    const double last = last_moment(), stretch = last_stretch(*known_);
    const double edge = time_base_.seconds(frames_);
    const bool counts = !following_ || !playing_ || store_.ready(last);
    if (passed > kMaxStepSeconds || (!counts && now_ - grown_at_ > stretch)) {
      edge_.extend_to(edge);
    } else if (counts) {
      edge_.observe(edge, stretch, now_);
    }
    if (is_growing()) return;
    growing_ = following_ = false;
    clock_.set_last(last);
    clock_.set_loop(loop_);
    move(false);
    tell(PlayerEvent::Kind::kFinished);
  }

  // What the rate is times for play to keep to the edge; jumps where that would take too long.
  double keep_up() {
    const double moment = seconds();
    if (!following_ && clock_.rate() > 0 && moment >= edge_.target(now_)) follow();
    if (!following_) return 1;
    if (!edge_.should_skip(moment, now_)) return edge_.rate_factor(moment, now_);
    go_to(time_base_.ticks(std::max(edge_.target(now_), 0.0)));
    tell(PlayerEvent::Kind::kSkipped);
    return 1;
  }

  // Whether a moment can be shown: its base is there, or will not come.
  bool can_show(double ticks) const {
    return store_.ready(ticks) && !(growing_ && ticks >= frames_);
  }

  void step(double passed) {
    const double pace = growing_ ? keep_up() : 1;
    if (state_ == PlayerState::kBuffering) {
      if (!can_resume()) return tell_standing();
      state_ = PlayerState::kPlaying;
      move(false);
      if (std::exchange(told_standing_, false)) tell(PlayerEvent::Kind::kResumed);
    }
    if (state_ != PlayerState::kPlaying) return;
    const PlaybackClock::Step next = clock_.after(pace * passed);
    if (!can_show(next.ticks)) {
      state_ = PlayerState::kBuffering;
      move(false);
      return tell_standing();
    }
    clock_.apply(next);
    if (next.ended) {
      playing_ = false;
      state_ = PlayerState::kEnded;
    }
    move(false);
    if (next.looped) tell(PlayerEvent::Kind::kLooped);
    if (next.ended) tell(PlayerEvent::Kind::kEnded);
  }

  const PlayerSettings settings_;
  std::function<void()> interrupt_;
  const std::shared_ptr<TransferEvents> transfers_;
  const TimeBase time_base_;
  std::shared_ptr<const SceneReader> known_;
  std::uint32_t frames_;
  PlaybackClock clock_;
  // Of a recording that grows.
  bool growing_ = false, following_ = false, to_edge_ = false, loop_ = false;
  double grown_at_ = 0;  // of the caller's clock
  LiveEdge edge_;
  PlayerState state_ = PlayerState::kPaused;
  bool playing_ = false, started_ = false, told_standing_ = false;
  double now_ = 0;
  int layers_ = -1;
  SegmentStore store_;
  std::unique_ptr<Timeline> timeline_;
  std::unique_ptr<Follower> follower_;
};

Result<std::unique_ptr<Player>> make(std::unique_ptr<ByteSource> source,
                                     const PlayerSettings& settings,
                                     std::function<void()> interrupt,
                                     std::shared_ptr<TransferEvents> transfers) {
  std::pmr::memory_resource* const memory =
      settings.memory != nullptr ? settings.memory.get() : std::pmr::get_default_resource();
  const auto pieces = std::make_shared<RangeSource>(std::move(source), memory);
  try {
    if (pieces->size() > settings.max_file_bytes) {
      return Status(StatusCode::kLimit,
                    fmt::format("{}: {} bytes, more than the limit of {}", pieces->name(),
                                pieces->size(), settings.max_file_bytes));
    }
    IndexCache cache;
    STGS_ASSIGN(const auto reader, open_snapshot(pieces, cache, settings.limits, memory));
    // Of one that lacks something the rest may be on its way.
    const bool is_whole = reader->form() != SceneForm::kGrowing && reader->damage().empty();
    if (is_whole) pieces->set_finished();
    return std::unique_ptr<Player>(std::make_unique<StreamPlayer>(
        reader, pieces, std::move(cache), settings, std::move(interrupt), std::move(transfers)));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: cannot be played: {}", pieces->name(), e.what()));
  }
}

}  // namespace

Result<std::unique_ptr<Player>> Player::open(const std::string& place,
                                             const PlayerSettings& settings) {
  STGS_TRY(check(settings));
  const auto transfers = std::make_shared<TransferEvents>(settings.on_opening_event);
  std::stop_source stop;
  // Who stops the transfers of his settings stops the player's.
  const auto linked = std::make_shared<std::stop_callback<std::function<void()>>>(
      settings.http.stop, [stop]() mutable { stop.request_stop(); });
  HttpSettings http = settings.http;
  http.max_connections =
      std::max(http.max_connections, settings.max_reads_in_flight + 1);  // and looks for growth
  http.stop = stop.get_token();
  http.on_event = [transfers, told = settings.http.on_event](const TransferEvent& event) {
    transfers->add(event);
    if (told) told(event);
  };
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_location(place, http));
  auto player = make(
      std::move(source), settings, [stop, linked]() mutable { stop.request_stop(); }, transfers);
  transfers->opened();
  return player;
}

Result<std::unique_ptr<Player>> Player::from_source(std::unique_ptr<ByteSource> source,
                                                    const PlayerSettings& settings,
                                                    std::function<void()> interrupt) {
  STGS_TRY(check(settings));
  return make(std::move(source), settings, std::move(interrupt),
              std::make_shared<TransferEvents>());
}

}  // namespace stgs::player
