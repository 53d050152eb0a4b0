// SPDX-License-Identifier: Apache-2.0
#include "stgs/player/player.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <mutex>
#include <stop_token>
#include <utility>

#include "stream/playback_clock.h"
#include "stream/segment_store.h"
#include "stream/stream_timeline.h"

namespace stgs::player {
namespace {

constexpr double kLongestStep = 0.25;  // seconds between advances that a moment follows

Status check(const PlayerSettings& s) {
  const auto positive = [](double v) { return std::isfinite(v) && v >= 0; };
  if (s.fetches < 1 || s.fetches > 64 || !positive(s.ahead_seconds) ||
      !positive(s.resume_seconds) || !positive(s.layer_patience_seconds) ||
      !positive(s.retry_seconds)) {
    return usage_error(
        "the player's settings are out of range: times must be 0 s or more, and 1 "
        "to 64 pieces fetched at once");
  }
  return {};
}

// What transfers met with, until it is asked for. Thread-safe.
class TransferEvents {
 public:
  void add(const TransferEvent& event) {
    if (event.kind == TransferEvent::Kind::kFailed) return;  // the pieces tell
    const bool replaced = event.kind == TransferEvent::Kind::kReplaced;
    PlayerEvent out;
    out.kind = replaced ? PlayerEvent::Kind::kReplaced : PlayerEvent::Kind::kRetry;
    out.offset = event.offset;
    out.code = StatusCode::kIo;
    out.message = event.message;
    const std::lock_guard lock(mutex_);
    if (replaced && std::exchange(told_replaced_, true)) return;
    events_.push_back(std::move(out));
  }
  std::vector<PlayerEvent> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(events_, {});
  }

 private:
  std::mutex mutex_;
  std::vector<PlayerEvent> events_;
  bool told_replaced_ = false;
};

class StreamPlayer final : public Player {
 public:
  StreamPlayer(std::unique_ptr<SceneReader> reader, PieceSource& source,
               const PlayerSettings& settings, std::function<void()> interrupt,
               std::shared_ptr<TransferEvents> transfers)
      : settings_(settings),
        interrupt_(std::move(interrupt)),
        transfers_(std::move(transfers)),
        time_base_(reader->metadata().time_base),
        frames_(reader->metadata().frames),
        clock_(frames_ > 0 ? frames_ - 1.0 : 0.0, time_base_.ticks(1.0)),
        store_(std::move(reader), source, settings),
        timeline_(make_stream_timeline(store_, source.name())) {
    move(true);
  }
  ~StreamPlayer() override {
    store_.stop();
    if (interrupt_) interrupt_();
  }

  Timeline& timeline() override { return *timeline_; }

  void play() override {
    if (clock_.at_end()) {
      clock_.seek(clock_.rate() < 0 ? frames_ : 0);
      move(true);
    }
    playing_ = true;
    state_ = PlayerState::kBuffering;
  }
  void pause() override {
    playing_ = false;
    state_ = PlayerState::kPaused;
    move(false);
  }
  Status seek(double seconds) override {
    if (!std::isfinite(seconds)) {
      return usage_error("a moment must be a number of seconds, not {}", seconds);
    }
    go_to(time_base_.ticks(seconds));
    return {};
  }
  Status seek_frame(std::uint32_t frame) override {
    if (frame >= frames_) {
      return usage_error("no frame {}, the clip has {}", frame, frames_);
    }
    go_to(frame);
    return {};
  }
  Status set_rate(double rate) override {
    if (!(rate >= kMinRate && rate <= kMaxRate) || rate == 0) {
      return usage_error("a rate must be from {} to {}, and not 0: {}", kMinRate, kMaxRate, rate);
    }
    clock_.set_rate(rate);
    move(false);
    return {};
  }
  void set_loop(bool loop) override {
    clock_.set_loop(loop);
    move(false);
  }

  double advance(double now) override {
    if (!std::isfinite(now)) return seconds();
    const double passed = std::clamp(now - now_, 0.0, kLongestStep);
    now_ = now;
    if (playing_) step(started_ ? passed : 0.0);
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
  bool ready() const override { return store_.ready(clock_.ticks()); }
  int layers() const override { return store_.layers(clock_.ticks()); }
  int layers_of_file() const override { return 2 * store_.tiers(); }
  bool settled() const override { return store_.settled(clock_.ticks()); }
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

  void go_to(double ticks) {
    clock_.seek(ticks);
    if (state_ == PlayerState::kEnded) state_ = PlayerState::kPaused;
    if (playing_) state_ = PlayerState::kBuffering;
    move(true);
  }

  void move(bool jumped) {
    Motion motion;
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

  void step(double passed) {
    if (state_ == PlayerState::kBuffering) {
      if (!can_resume()) return;
      state_ = PlayerState::kPlaying;
      move(false);
      tell(PlayerEvent::Kind::kResumed);
    }
    if (state_ != PlayerState::kPlaying) return;
    const PlaybackClock::Step next = clock_.after(passed);
    if (!store_.ready(next.ticks)) {
      state_ = PlayerState::kBuffering;
      move(false);
      return tell(PlayerEvent::Kind::kBuffering);
    }
    clock_.take(next);
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
  const std::uint32_t frames_;
  PlaybackClock clock_;
  PlayerState state_ = PlayerState::kPaused;
  bool playing_ = false, started_ = false;
  double now_ = 0;
  int layers_ = -1;
  SegmentStore store_;
  std::unique_ptr<Timeline> timeline_;
};

Result<std::unique_ptr<Player>> make(std::unique_ptr<ByteSource> source,
                                     const PlayerSettings& settings,
                                     std::function<void()> interrupt,
                                     std::shared_ptr<TransferEvents> transfers) {
  std::pmr::memory_resource* const memory =
      settings.memory != nullptr ? settings.memory.get() : std::pmr::get_default_resource();
  auto pieces = std::make_unique<PieceSource>(std::move(source), memory);
  PieceSource& of_reader = *pieces;
  STGS_ASSIGN(auto reader, SceneReader::open(std::move(pieces), settings.limits, memory));
  const std::string name = of_reader.name();
  try {
    return std::unique_ptr<Player>(std::make_unique<StreamPlayer>(
        std::move(reader), of_reader, settings, std::move(interrupt), std::move(transfers)));
  } catch (const std::exception& e) {
    return Status(code_of(e), fmt::format("{}: cannot be played: {}", name, e.what()));
  }
}

}  // namespace

Result<std::unique_ptr<Player>> Player::open(const std::string& place,
                                             const PlayerSettings& settings) {
  STGS_TRY(check(settings));
  const auto transfers = std::make_shared<TransferEvents>();
  std::stop_source stop;
  // Who stops the transfers of his settings stops the player's.
  const auto linked = std::make_shared<std::stop_callback<std::function<void()>>>(
      settings.http.stop, [stop]() mutable { stop.request_stop(); });
  HttpSettings http = settings.http;
  http.connections = std::max(http.connections, settings.fetches);
  http.stop = stop.get_token();
  http.on_event = [transfers, told = settings.http.on_event](const TransferEvent& event) {
    transfers->add(event);
    if (told) told(event);
  };
  STGS_ASSIGN(std::unique_ptr<ByteSource> source, open_place(place, http));
  return make(
      std::move(source), settings, [stop, linked]() mutable { stop.request_stop(); }, transfers);
}

Result<std::unique_ptr<Player>> Player::over(std::unique_ptr<ByteSource> source,
                                             const PlayerSettings& settings,
                                             std::function<void()> interrupt) {
  STGS_TRY(check(settings));
  return make(std::move(source), settings, std::move(interrupt),
              std::make_shared<TransferEvents>());
}

}  // namespace stgs::player
