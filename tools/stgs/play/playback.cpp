// SPDX-License-Identifier: Apache-2.0
#include "play/playback.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "damage.h"
#include "scene_input.h"

namespace stgs::tools {
namespace {

using player::PlayerEvent;
using player::PlayerState;

constexpr double kNoticeSeconds = 6;
constexpr std::size_t kMaxNotices = 5;
constexpr double kSameFrame = 1e-6;  // ticks

}  // namespace

Playback::Playback(Session& session, const PlaybackSettings& settings)
    : session_(session), settings_(settings) {
  player::PlayerSettings player_settings;
  player_settings.memory_budget = settings.memory;
  player_settings.http.stop = stop_.get_token();
  player_settings.on_opening_event = [this](const PlayerEvent& event) {
    const std::lock_guard lock(opening_mutex_);
    opening_events_.push_back(event);
  };
  opening_ = std::async(std::launch::async, [file = settings.file, player_settings] {
    return player::Player::open(file, player_settings);
  });
}

Playback::~Playback() {
  stop_.request_stop();
  if (opening_.valid()) opening_.wait();
}

Result<bool> Playback::is_open() {
  if (player_ != nullptr) return true;
  const bool ended = opening_.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  {
    const std::lock_guard lock(opening_mutex_);
    for (const PlayerEvent& event : opening_events_) warn_of_event(session_, event);
    opening_events_.clear();
  }
  if (!ended) return false;
  Result<std::unique_ptr<player::Player>> player = opening_.get();
  if (!player.ok()) return player.status();
  player_ = std::move(player).value();
  STGS_TRY(begin());
  return true;
}

Status Playback::begin() {
  warn_of_open_damage(session_, player_->timeline());
  if (settings_.seconds > duration()) {
    return usage_error("--time {} is out of range; {} lasts from 0 to {:.6g} s", settings_.seconds,
                       player::display_location(settings_.file), duration());
  }
  loop_ = settings_.loop;
  player_->set_loop(loop_);
  rate_ = settings_.rate;
  STGS_TRY(player_->set_rate(rate_));
  // A growing recording starts at its live edge.
  if (settings_.seconds > 0 || !player_->live().growing) STGS_TRY(player_->seek(settings_.seconds));
  // At the last frame there is nothing to play; play() would restart from the beginning.
  const bool at_end = settings_.seconds > 0 && rate_ > 0 && !loop_ && !player_->live().growing &&
                      frame() + 1 >= player_->timeline().metadata().frames;
  if (!settings_.paused && !at_end) player_->play();
  return {};
}

double Playback::advance(double now) {
  const bool played = player_->state() == PlayerState::kPlaying;
  const double seconds = player_->advance(now);
  if (played && player_->state() == PlayerState::kBuffering) ++stalls_;
  if (player_->live().following) rate_ = 1;
  take_events(now);
  return seconds;
}

bool Playback::is_playing() const {
  const PlayerState state = player_->state();
  return state == PlayerState::kPlaying || state == PlayerState::kBuffering;
}

double Playback::duration() const {
  return player_->timeline().duration_seconds();
}

std::uint32_t Playback::frame() const {
  const SceneMetadata& scene = player_->timeline().metadata();
  const double ticks = std::floor(scene.time_base.ticks(player_->seconds()) + kSameFrame);
  return static_cast<std::uint32_t>(
      std::clamp(ticks, 0.0, std::max(static_cast<double>(scene.frames) - 1, 0.0)));
}

double Playback::bits_per_second() const {
  const player::Timeline& timeline = player_->timeline();
  const double seconds = timeline.metadata().frames > 1 ? duration() : 0;
  return seconds > 0 ? 8 * static_cast<double>(timeline.reader().file_bytes()) / seconds : 0;
}

double Playback::buffered_ahead() const {
  const double at = player_->seconds();
  for (const player::TimeRange& range : player_->buffered()) {
    if (range.begin <= at && at <= range.end) return rate_ < 0 ? at - range.begin : range.end - at;
  }
  return 0;
}

bool Playback::is_complete() const {
  return player_->ready() && player_->layers() >= player_->layer_count();
}

void Playback::toggle_pause() {
  if (is_playing()) {
    player_->pause();
  } else {
    player_->play();
  }
}

void Playback::step(int frames) {
  const std::int64_t last = std::int64_t{player_->timeline().metadata().frames} - 1;
  if (last < 0) return;
  player_->pause();
  std::int64_t to = std::int64_t{frame()} + frames;
  if (to < 0) to = loop_ ? last : 0;
  if (to > last) to = loop_ ? 0 : last;
  (void)player_->seek_frame(static_cast<std::uint32_t>(to));  // cannot fail: it is in range
}

void Playback::seek(double seconds) {
  (void)player_->seek(std::clamp(seconds, 0.0, duration()));  // cannot fail: it is finite
}

void Playback::set_rate(double rate) {
  if (player_->set_rate(rate).ok()) rate_ = rate;
}

void Playback::change_rate(int by) {
  const auto* const end = std::end(kRates);
  if (by > 0) {
    const auto* const next = std::upper_bound(std::begin(kRates), end, rate_);
    if (next != end) set_rate(*next);
  } else {
    const auto* const at = std::lower_bound(std::begin(kRates), end, rate_);
    if (at != std::begin(kRates)) set_rate(*(at - 1));
  }
}

void Playback::toggle_loop() {
  loop_ = !loop_;
  player_->set_loop(loop_);
}

void Playback::take_events(double now) {
  for (const PlayerEvent& event : player_->take_events()) {
    if (event.message.empty()) continue;
    notices_.push_back({now, fmt::format("{}: {}", event_text(event.kind), event.message)});
    warn_of_event(session_, event);
  }
}

void Playback::warn(double now, const std::string& text) {
  notices_.push_back({now, text});
  session_.log(1, text);
}

std::vector<std::string> Playback::notices(double now) {
  while (!notices_.empty() &&
         (notices_.size() > kMaxNotices || notices_.front().when + kNoticeSeconds < now)) {
    notices_.pop_front();
  }
  std::vector<std::string> lines;
  for (const Notice& notice : notices_) lines.push_back(notice.text);
  return lines;
}

}  // namespace stgs::tools
