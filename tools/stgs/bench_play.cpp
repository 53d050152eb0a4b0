// SPDX-License-Identifier: Apache-2.0
#include "bench_play.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <utility>

#include "damage.h"
#include "stgs/player/player.h"

namespace stgs::tools {
namespace {

constexpr double kPoll = 0.001;            // seconds
constexpr double kFailedReadTimeout = 10;  // at most, without a byte after a failed read, seconds
constexpr double kMaxRefreshes = 1e7;

void sleep(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

class TimelinePlayback final : public MeasuredPlayback {
 public:
  TimelinePlayback(std::unique_ptr<player::Timeline> timeline, double rate)
      : timeline_(std::move(timeline)), rate_(rate) {}
  player::Timeline& timeline() override { return *timeline_; }
  Result<double> advance(double passed) override {
    return std::fmod(passed * rate_, timeline_->duration_seconds());
  }
  bool is_buffering() const override { return false; }
  bool is_complete() const override { return true; }
  int report_events(Session& /*session*/) override { return 0; }

 private:
  std::unique_ptr<player::Timeline> timeline_;
  double rate_;
};

class PlayerPlayback final : public MeasuredPlayback {
 public:
  using Event = player::PlayerEvent;

  PlayerPlayback(std::unique_ptr<player::Player> player, double timeout)
      : player_(std::move(player)), timeout_(timeout) {}
  player::Timeline& timeline() override { return player_->timeline(); }
  Result<double> advance(double passed) override {
    if (player_->state() == player::PlayerState::kPaused) STGS_TRY(begin());
    // The player limits a step to kMaxStepSeconds. Take several, so that dropped frames are
    // skipped.
    for (; passed_ + player::kMaxStepSeconds < passed; passed_ += player::kMaxStepSeconds) {
      player_->advance(passed_ + player::kMaxStepSeconds);
    }
    passed_ = passed;
    return player_->advance(passed);
  }
  bool is_buffering() const override { return player_->state() == player::PlayerState::kBuffering; }
  bool is_complete() const override { return player_->layers() >= player_->layer_count(); }
  int report_events(Session& session) override {
    take_events();
    int failed = 0;
    for (const Event& event : std::exchange(events_, {})) {
      warn_of_event(session, event);
      failed += event.kind != Event::Kind::kRetry;
    }
    has_failed_ |= failed > 0;
    if (!warned_of_memory_ && !has_failed_ && !is_complete() && player_->is_complete()) {
      warned_of_memory_ = true;
      session.log(1, fmt::format("{}: frames are incomplete because --memory is too small",
                                 player_->timeline().name()));
    }
    return failed;
  }

 private:
  // Starts playback and blocks until it runs. The player's clock stays at 0 meanwhile.
  Status begin() {
    player_->play();
    std::uint64_t fetched = 0;
    double last_bytes = now_seconds();
    while (player_->advance(0), player_->state() != player::PlayerState::kPlaying) {
      take_events();
      if (interrupted()) return runtime_error("playback has not begun");
      const double now = now_seconds();
      if (std::uint64_t so_far = player_->statistics().fetched_bytes; so_far != fetched) {
        fetched = so_far;
        last_bytes = now;
      }
      // A pending read fails at its own limit, with a reason.
      const double limit = events_.empty() ? timeout_ + 1 : std::min(timeout_, kFailedReadTimeout);
      if (now - last_bytes > limit) {
        if (!events_.empty()) return io_error("playback cannot begin: {}", events_.back().message);
        return runtime_error("playback has not begun: no data for {:g} s", timeout_);
      }
      sleep(kPoll);
    }
    return {};
  }

  // Collects the events that report a problem.
  void take_events() {
    for (Event& event : player_->take_events()) {
      if (!event.message.empty()) events_.push_back(std::move(event));
    }
  }

  std::unique_ptr<player::Player> player_;
  double timeout_;             // seconds
  std::vector<Event> events_;  // not yet reported
  bool has_failed_ = false, warned_of_memory_ = false;
  double passed_ = 0;  // argument of the last advance()
};

}  // namespace

std::unique_ptr<MeasuredPlayback> playback_of(std::unique_ptr<player::Timeline> timeline,
                                              double rate) {
  return std::make_unique<TimelinePlayback>(std::move(timeline), rate);
}

Result<std::unique_ptr<MeasuredPlayback>> playback_of(std::unique_ptr<ByteSource> source,
                                                      std::uint64_t memory_budget, double rate,
                                                      double timeout) {
  player::PlayerSettings settings;
  settings.memory_budget = memory_budget;
  settings.live.follow = false;  // play a growing file from its beginning
  STGS_ASSIGN(auto player, player::Player::from_source(std::move(source), settings));
  STGS_TRY(player->set_rate(rate));
  player->set_loop(true);
  return std::unique_ptr<MeasuredPlayback>(
      std::make_unique<PlayerPlayback>(std::move(player), timeout));
}

Result<Played> play(Session& session, MeasuredPlayback& playback, player::Renderer& renderer,
                    const std::vector<player::View>& views, const PlaySettings& settings,
                    const std::string& file) {
  Played out;
  player::RenderStats stats;
  const auto render = [&](double due) -> Status {
    STGS_ASSIGN(const double seconds, playback.advance(due));
    return with_render_time(renderer.draw(playback.timeline(), seconds, views, &stats), file,
                            seconds);
  };
  const double period = 1 / settings.refresh;
  const SceneMetadata& metadata = playback.timeline().metadata();
  const double length = metadata.time_base.seconds(settings.frames) / settings.rate;
  const double refreshes = std::max(1.0, std::ceil(length / period - 1e-9));
  if (!(refreshes <= kMaxRefreshes)) {
    return usage_error(
        "--frames {} at --rate {} and --refresh {} takes {:.3g} refreshes (at most {:.0f})",
        settings.frames, settings.rate, settings.refresh, refreshes, kMaxRefreshes);
  }
  out.refreshes = static_cast<int>(refreshes);
  const double begin = now_seconds();
  STGS_TRY(render(0));
  const double start = now_seconds();
  out.start_ms = 1e3 * (start - begin);
  for (int k = 0; k < out.refreshes; ++k) {
    const double due = k * period;
    const double early = due - (now_seconds() - start);
    if (early > 0) sleep(early);
    if (k == 0 || early > -period) {
      const double begun = now_seconds();
      STGS_TRY(render(due));
      const double end = now_seconds();
      out.pass.add(1e3 * (end - begun), stats);
      out.missed += end - start > due + period;
      out.stalled += playback.is_buffering();
      out.incomplete += !playback.is_complete() || stats.pending > 0;
    } else {
      ++out.missed;
    }
    out.failed_reads += playback.report_events(session);
    if (!session.progress("play", static_cast<std::size_t>(k) + 1,
                          static_cast<std::size_t>(out.refreshes))) {
      return runtime_error("the benchmark is not complete");
    }
  }
  out.seconds = now_seconds() - start;
  return out;
}

Json to_json(const Played& played, const PlaySettings& settings) {
  const Pass& pass = played.pass;
  return {{"frames", settings.frames},
          {"refresh", settings.refresh},
          {"rate", settings.rate},
          {"refreshes", played.refreshes},
          {"missed", played.missed},
          {"stalled", played.stalled},
          {"incomplete", played.incomplete},
          {"failed_reads", played.failed_reads},
          {"start_ms", played.start_ms},
          {"max_ms", percentile(pass.frame, 1)},
          {"fetch_share", sum(pass.fetch) / std::max(sum(pass.frame), 1e-9)},
          {"busy_share", sum(pass.frame) / (1e3 * played.seconds)},
          {"rendering", to_json(pass)}};
}

std::string to_text(const Played& played, const PlaySettings& settings) {
  const Pass& pass = played.pass;
  return fmt::format(
      "{} at rate {}, {} refreshes/s: {} of {} missed, {} stalled, {} incomplete; first frame "
      "after "
      "{:.1f} ms, slowest {:.3f} ms\n"
      "fetching takes {:.1f} % of rendering, rendering {:.1f} % of the time\n{}",
      plural(settings.frames, "frame"), settings.rate, settings.refresh, played.missed,
      played.refreshes, played.stalled, played.incomplete, played.start_ms,
      percentile(pass.frame, 1), 1e2 * sum(pass.fetch) / std::max(sum(pass.frame), 1e-9),
      1e-1 * sum(pass.frame) / played.seconds, to_text("play", pass));
}

}  // namespace stgs::tools
