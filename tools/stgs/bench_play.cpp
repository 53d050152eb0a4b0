// SPDX-License-Identifier: Apache-2.0
#include "bench_play.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <utility>

#include "losses.h"
#include "stgs/player/player.h"

namespace stgs::tools {
namespace {

constexpr double kPoll = 0.001;  // seconds
// Seconds without a byte that play is given to begin, and once something could not be read.
constexpr double kPatience = 60, kLostPatience = 10;
constexpr double kMostPictures = 1e7;

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
  bool waits() const override { return false; }
  bool is_whole() const override { return true; }
  int tell(Session& /*session*/) override { return 0; }

 private:
  std::unique_ptr<player::Timeline> timeline_;
  double rate_;
};

class PlayerPlayback final : public MeasuredPlayback {
 public:
  using Event = player::PlayerEvent;

  explicit PlayerPlayback(std::unique_ptr<player::Player> player) : player_(std::move(player)) {}
  player::Timeline& timeline() override { return player_->timeline(); }
  Result<double> advance(double passed) override {
    if (player_->state() == player::PlayerState::kPaused) STGS_TRY(begin());
    // A longer step would count as this one: pictures that are missed are passed, not waited for.
    for (; passed_ + player::kMaxStepSeconds < passed; passed_ += player::kMaxStepSeconds) {
      player_->advance(passed_ + player::kMaxStepSeconds);
    }
    passed_ = passed;
    return player_->advance(passed);
  }
  bool waits() const override { return player_->state() == player::PlayerState::kBuffering; }
  bool is_whole() const override { return player_->layers() >= player_->layer_count(); }
  int tell(Session& session) override {
    take_events();
    int lost = 0;
    for (const Event& event : std::exchange(events_, {})) {
      tell_event(session, event);
      lost += event.kind != Event::Kind::kRetry;
    }
    ever_lost_ |= lost > 0;
    if (!told_no_room_ && !ever_lost_ && !is_whole() && player_->is_complete()) {
      told_no_room_ = true;
      session.log(1, fmt::format("{}: pictures lack what has no room in --memory; allow more",
                                 player_->timeline().name()));
    }
    return lost;
  }

 private:
  // The player's clock stands at 0 meanwhile, and goes on from there.
  Status begin() {
    player_->play();
    std::uint64_t fetched = 0;
    double come = now_seconds();  // the last bytes
    while (player_->advance(0), player_->state() != player::PlayerState::kPlaying) {
      take_events();
      if (interrupted()) return runtime_error("play has not begun");
      const double now = now_seconds();
      if (std::uint64_t so_far = player_->statistics().fetched_bytes; so_far != fetched) {
        fetched = so_far;
        come = now;
      }
      if (now - come > (events_.empty() ? kPatience : kLostPatience)) {
        if (!events_.empty()) return io_error("play cannot begin: {}", events_.back().message);
        return runtime_error("play has not begun, and nothing has come for {} s", kPatience);
      }
      sleep(kPoll);
    }
    return {};
  }

  // Keeps those that tell of something wrong.
  void take_events() {
    for (Event& event : player_->take_events()) {
      if (!event.message.empty()) events_.push_back(std::move(event));
    }
  }

  std::unique_ptr<player::Player> player_;
  std::vector<Event> events_;  // that are still to be told
  bool ever_lost_ = false, told_no_room_ = false;
  double passed_ = 0;  // of the last advance()
};

}  // namespace

std::unique_ptr<MeasuredPlayback> playback_of(std::unique_ptr<player::Timeline> timeline,
                                              double rate) {
  return std::make_unique<TimelinePlayback>(std::move(timeline), rate);
}

Result<std::unique_ptr<MeasuredPlayback>> playback_of(std::unique_ptr<ByteSource> source,
                                                      std::uint64_t memory_budget, double rate) {
  player::PlayerSettings settings;
  settings.memory_budget = memory_budget;
  settings.live.follow = false;  // frames of what there is, from the beginning
  STGS_ASSIGN(auto player, player::Player::from_source(std::move(source), settings));
  STGS_TRY(player->set_rate(rate));
  player->set_loop(true);
  return std::unique_ptr<MeasuredPlayback>(std::make_unique<PlayerPlayback>(std::move(player)));
}

Result<Played> play(Session& session, MeasuredPlayback& playback, player::Renderer& renderer,
                    const std::vector<player::View>& views, const PlaySettings& settings,
                    const std::string& file) {
  Played out;
  player::RenderStats stats;
  const auto draw = [&](double due) -> Status {
    STGS_ASSIGN(const double seconds, playback.advance(due));
    return at_moment(renderer.draw(playback.timeline(), seconds, views, &stats), file, seconds);
  };
  const double period = 1 / settings.refresh;
  const SceneMetadata& metadata = playback.timeline().metadata();
  const double length = metadata.time_base.seconds(settings.frames) / settings.rate;
  const double pictures = std::max(1.0, std::ceil(length / period - 1e-9));
  if (!(pictures <= kMostPictures)) {
    return usage_error(
        "--frames {} at --rate {} and --refresh {} are {:.3g} pictures, more than {}",
        settings.frames, settings.rate, settings.refresh, pictures, kMostPictures);
  }
  out.pictures = static_cast<int>(pictures);
  const double begin = now_seconds();
  STGS_TRY(draw(0));
  const double start = now_seconds();
  out.start_ms = 1e3 * (start - begin);
  for (int k = 0; k < out.pictures; ++k) {
    const double due = k * period;
    const double early = due - (now_seconds() - start);
    if (early > 0) sleep(early);
    if (k == 0 || early > -period) {
      const double begun = now_seconds();
      STGS_TRY(draw(due));
      const double end = now_seconds();
      out.pass.add(1e3 * (end - begun), stats);
      out.missed += end - start > due + period;
      out.waited += playback.waits();
      out.incomplete += !playback.is_whole() || stats.pending > 0;
    } else {
      ++out.missed;
    }
    out.lost += playback.tell(session);
    if (!session.progress("play", static_cast<std::size_t>(k) + 1,
                          static_cast<std::size_t>(out.pictures))) {
      return runtime_error("the measurement is not complete");
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
          {"refreshes", played.pictures},
          {"missed", played.missed},
          {"stalled", played.waited},
          {"incomplete", played.incomplete},
          {"failed_reads", played.lost},
          {"start_ms", played.start_ms},
          {"max_ms", percentile(pass.frame, 1)},
          {"fetch_share", sum(pass.fetch) / std::max(sum(pass.frame), 1e-9)},
          {"busy_share", sum(pass.frame) / (1e3 * played.seconds)},
          {"rendering", to_json(pass)}};
}

std::string to_text(const Played& played, const PlaySettings& settings) {
  const Pass& pass = played.pass;
  return fmt::format(
      "{} frames at {} times their rate, {} pictures a second: {} of {} missed, {} waited for what "
      "is next, {} lacked layers; the first after {:.1f} ms, the longest {:.3f} ms\n"
      "fetching is {:.1f} % of drawing, drawing {:.1f} % of the time\n{}",
      settings.frames, settings.rate, settings.refresh, played.missed, played.pictures,
      played.waited, played.incomplete, played.start_ms, percentile(pass.frame, 1),
      1e2 * sum(pass.fetch) / std::max(sum(pass.frame), 1e-9),
      1e-1 * sum(pass.frame) / played.seconds, to_text("play", pass));
}

}  // namespace stgs::tools
