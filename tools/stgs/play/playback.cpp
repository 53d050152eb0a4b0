// SPDX-License-Identifier: Apache-2.0
#include "play/playback.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "location.h"
#include "player_events.h"
#include "scene_file.h"
#include "stgs/format/gaussian4d.h"

namespace stgs::tools {
namespace {

constexpr double kNoticeSeconds = 6;
constexpr std::size_t kMaxNotices = 5;
constexpr double kSameFrame = 1e-6;  // ticks

}  // namespace

Result<std::unique_ptr<Playback>> Playback::start(Session& session,
                                                  const PlaybackSettings& settings) {
  auto playback = std::make_unique<Playback>(session, settings);
  STGS_TRY(playback->create());
  STGS_TRY(playback->check(stgs_player_open(playback->player_.get(), settings.file.c_str())));
  return playback;
}

Status Playback::create() {
  status_ = sized<stgs_player_status>();
  info_ = sized<stgs_scene_info>();
  stgs_player_settings settings;
  if (stgs_player_settings_defaults(&settings, sizeof(settings)) != STGS_OK) {
    return runtime_error("the library is older than the program");
  }
  settings.memory_budget = settings_.memory;
  settings.max_memory = settings_.memory;
  settings.url_timeout_seconds = session_.options.timeout;
  settings.url_allow_private = session_.options.allow_private ? 1 : 0;
  stgs_player* player = nullptr;
  const stgs_result created = stgs_player_create(&settings, &player);
  if (created != STGS_OK) {
    return runtime_error("{}: {}", display_name(settings_.file), stgs_result_name(created));
  }
  player_.reset(player);
  return {};
}

Status Playback::check(stgs_result result) const {
  return status_of(result, player_.get(), stgs_player_error);
}

Result<bool> Playback::is_open(double now) {
  if (is_open_) return true;
  STGS_TRY(check(stgs_player_update(player_.get(), now, &status_)));
  const bool has_ended = status_.state != STGS_PLAYER_OPENING;
  STGS_TRY(take_opening_events());
  if (!has_ended) return false;
  STGS_TRY(check(stgs_player_wait_open(player_.get())));  // the result of opening
  STGS_TRY(begin());
  is_open_ = true;
  opened_at_ = now;
  return true;
}

Status Playback::begin() {
  STGS_TRY(update_info());
  STGS_TRY(warn_of_open_damage(session_, scene(), text_of(scene(), STGS_TEXT_NAME)));
  if (settings_.seconds > duration()) {
    return usage_error("--time {} is out of range; {} lasts from 0 to {:.6g} s", settings_.seconds,
                       display_name(settings_.file), duration());
  }
  stgs_player* const player = player_.get();
  loop_ = settings_.loop;
  STGS_TRY(check(stgs_player_set_loop(player, loop_ ? 1 : 0)));
  rate_ = settings_.rate;
  STGS_TRY(check(stgs_player_set_rate(player, rate_)));
  // A growing recording starts at its live edge.
  const bool is_growing = live().growing != 0;
  if (settings_.seconds > 0 || !is_growing) {
    STGS_TRY(check(stgs_player_seek(player, settings_.seconds)));
  }
  STGS_TRY(check(stgs_player_get_status(player, &status_)));
  // At the last frame there is nothing to play; playing would restart from the beginning.
  const bool at_end =
      settings_.seconds > 0 && rate_ > 0 && !loop_ && !is_growing && frame() + 1 >= info_.frames;
  if (!settings_.paused && !at_end) STGS_TRY(check(stgs_player_play(player)));
  return check(stgs_player_get_status(player, &status_));
}

Result<double> Playback::advance(double now) {
  const bool played = status_.state == STGS_PLAYER_PLAYING;
  STGS_TRY(check(stgs_player_update(player_.get(), now, &status_)));
  STGS_TRY(update_info());
  if (played && status_.state == STGS_PLAYER_BUFFERING) ++stalls_;
  if (live().following != 0) rate_ = 1;
  STGS_TRY(take_events(now));
  STGS_TRY(check_start(now));
  return status_.seconds;
}

Status Playback::check_start(double now) {
  has_shown_ = has_shown_ || status_.ready != 0 || status_.layers > 0;
  const double waited = now - opened_at_;
  if (has_shown_ || failed_read_.empty() || waited < session_.options.timeout) return {};
  return io_error("{}; nothing could be shown for {:.1f} s", failed_read_, waited);
}

Status Playback::update_info() {
  return status_of(stgs_scene_get_info(scene(), &info_), scene(), stgs_scene_error);
}

stgs_player_live Playback::live() const {
  auto live = sized<stgs_player_live>();
  (void)stgs_player_get_live(player_.get(), &live);  // cannot fail
  return live;
}

bool Playback::is_playing() const {
  return status_.state == STGS_PLAYER_PLAYING || status_.state == STGS_PLAYER_BUFFERING;
}

std::uint32_t Playback::frame() const {
  const TimeBase time_base{info_.time_base_numerator, info_.time_base_denominator};
  const double ticks = std::floor(time_base.ticks(status_.seconds) + kSameFrame);
  return static_cast<std::uint32_t>(
      std::clamp(ticks, 0.0, std::max(static_cast<double>(info_.frames) - 1, 0.0)));
}

double Playback::bits_per_second() const {
  const double seconds = info_.frames > 1 ? duration() : 0;
  return seconds > 0 ? 8 * static_cast<double>(info_.file_bytes) / seconds : 0;
}

stgs_player_statistics Playback::statistics() const {
  auto statistics = sized<stgs_player_statistics>();
  (void)stgs_player_get_statistics(player_.get(), &statistics);  // cannot fail
  return statistics;
}

std::vector<stgs_time_range> Playback::buffered() const {
  std::vector<stgs_time_range> ranges(8);
  for (;;) {
    std::uint32_t count = 0;
    const auto capacity = static_cast<std::uint32_t>(ranges.size());
    if (stgs_player_get_buffered(player_.get(), ranges.data(), capacity, &count) != STGS_OK) {
      return {};  // out of memory
    }
    ranges.resize(count);
    if (count <= capacity) return ranges;
  }
}

double Playback::buffered_ahead() const {
  const double at = seconds();
  for (const stgs_time_range& range : buffered()) {
    if (range.begin <= at && at <= range.end) return rate_ < 0 ? at - range.begin : range.end - at;
  }
  return 0;
}

void Playback::control(stgs_result result) {
  if (const Status status = check(result); !status.ok()) session_.log(1, status.message());
  (void)stgs_player_get_status(player_.get(), &status_);  // cannot fail
}

void Playback::toggle_pause() {
  control(is_playing() ? stgs_player_pause(player_.get()) : stgs_player_play(player_.get()));
}

void Playback::step(int frames) {
  const std::int64_t last = std::int64_t{info_.frames} - 1;
  if (last < 0) return;
  control(stgs_player_pause(player_.get()));
  std::int64_t to = std::int64_t{frame()} + frames;
  if (to < 0) to = loop_ ? last : 0;
  if (to > last) to = loop_ ? 0 : last;
  control(stgs_player_seek_frame(player_.get(), static_cast<std::uint32_t>(to)));
}

void Playback::seek(double seconds) {
  control(stgs_player_seek(player_.get(), std::clamp(seconds, 0.0, duration())));
}

void Playback::set_rate(double rate) {
  const stgs_result result = stgs_player_set_rate(player_.get(), rate);
  if (result == STGS_OK) rate_ = rate;
  control(result);
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
  control(stgs_player_set_loop(player_.get(), loop_ ? 1 : 0));
}

Result<stgs_player_event> Playback::next_event() {
  auto event = sized<stgs_player_event>();
  STGS_TRY(check(stgs_player_next_event(player_.get(), &event)));
  return event;
}

Status Playback::take_events(double now) {
  for (;;) {
    STGS_ASSIGN(const stgs_player_event event, next_event());
    if (event.kind == STGS_EVENT_NONE) return {};
    if (*event.message != '\0') report(now, event);
  }
}

// Reports the events of opening, except its result and the damage that warn_of_open_damage()
// reports. Later events stay queued.
Status Playback::take_opening_events() {
  for (;;) {
    STGS_ASSIGN(const stgs_player_event event, next_event());
    if (event.kind == STGS_EVENT_NONE) return {};
    if (event.kind == STGS_EVENT_OPENED) return skip_opening_damage();
    if (event.kind != STGS_EVENT_FAILED && *event.message != '\0') {
      warn_of_event(session_, event.kind, event.offset, event.message);
    }
  }
}

// Removes the events that follow STGS_EVENT_OPENED: one per error found while opening.
Status Playback::skip_opening_damage() {
  STGS_TRY(update_info());
  int errors = 0;
  for (std::uint32_t i = 0; i < info_.issues && errors < STGS_MAX_OPENING_DAMAGE; ++i) {
    auto issue = sized<stgs_issue>();
    STGS_TRY(status_of(stgs_scene_get_issue(scene(), i, &issue), scene(), stgs_scene_error));
    errors += issue.is_error != 0 ? 1 : 0;
  }
  for (; errors > 0; --errors) STGS_TRY(next_event().status());
  return {};
}

void Playback::report(double now, const stgs_player_event& event) {
  if (event.kind == STGS_EVENT_READ_FAILED || event.kind == STGS_EVENT_REPLACED) {
    failed_read_ = event.message;
  }
  notices_.push_back({now, fmt::format("{}: {}", event_text(event.kind), event.message)});
  warn_of_event(session_, event.kind, event.offset, event.message);
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
