// SPDX-License-Identifier: Apache-2.0
#include "player.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <utility>

#include "structs.h"
#include "transfer_settings.h"

using stgs::player::PlayerEvent;
using stgs::player::PlayerState;
using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

constexpr double kMinMemory = stgs::sdk::kMinMemoryBudget;
constexpr double kMax = std::numeric_limits<double>::max();  // any finite value

stgs_player_settings default_player_settings() {
  const stgs::player::PlayerSettings defaults;
  stgs_player_settings settings{};
  settings.struct_size = sizeof(settings);
  settings.memory_budget = defaults.memory_budget;
  settings.max_file_bytes = INT64_MAX;
  settings.max_primitives = defaults.limits.max_primitives;
  settings.max_memory = stgs::player::kDefaultMemoryBudget;
  settings.prefetch_seconds = defaults.prefetch_seconds;
  settings.resume_seconds = defaults.resume_seconds;
  settings.layer_lead_seconds = defaults.layer_lead_seconds;
  settings.retry_seconds = defaults.retry_seconds;
  settings.max_reads_in_flight = static_cast<std::uint32_t>(defaults.max_reads_in_flight);
  settings.url_max_attempts = static_cast<std::uint32_t>(defaults.http.max_attempts);
  settings.url_connect_seconds = defaults.http.connect_seconds;
  settings.url_stall_seconds = defaults.http.stall_seconds;
  settings.live_follow = defaults.live.follow ? 1 : 0;
  settings.live_latency_seconds = defaults.live.latency_seconds;
  settings.live_poll_seconds = defaults.live.poll_seconds;
  settings.live_stall_seconds = defaults.live.stall_seconds;
  settings.live_skip_seconds = defaults.live.skip_seconds;
  stgs::sdk::fill_transfer_settings(defaults.http, settings);
  return settings;
}

// Returns a message about the first setting that is out of range; empty if there is none.
std::string out_of_range(const stgs_player_settings& s) {
  const struct {
    const char* name;
    double value, min, max;
  } ranges[] = {{"memory_budget", static_cast<double>(s.memory_budget), kMinMemory, kMax},
                {"max_memory", static_cast<double>(s.max_memory), kMinMemory, kMax},
                {"prefetch_seconds", s.prefetch_seconds, 0, kMax},
                {"resume_seconds", s.resume_seconds, 0, kMax},
                {"layer_lead_seconds", s.layer_lead_seconds, 0, kMax},
                {"retry_seconds", s.retry_seconds, 0, kMax},
                {"max_reads_in_flight", static_cast<double>(s.max_reads_in_flight), 1, 64},
                {"url_max_attempts", static_cast<double>(s.url_max_attempts), 1, 1000},
                {"url_connect_seconds", s.url_connect_seconds, 0, kMax},
                {"url_stall_seconds", s.url_stall_seconds, 0, kMax},
                {"live_latency_seconds", s.live_latency_seconds, 0, kMax},
                {"live_poll_seconds", s.live_poll_seconds, 0, kMax},
                {"live_stall_seconds", s.live_stall_seconds, 0, kMax},
                {"live_skip_seconds", s.live_skip_seconds, 0, kMax},
                {"url_timeout_seconds", s.url_timeout_seconds, stgs::player::kMinRequestSeconds,
                 stgs::player::kMaxRequestSeconds},
                {"url_min_bytes_per_second", s.url_min_bytes_per_second,
                 stgs::player::kMinBytesPerSecond, stgs::player::kMaxBytesPerSecond}};
  for (const auto& [name, value, min, max] : ranges) {
    if (value >= min && value <= max) continue;
    const std::string range =
        max == kMax ? fmt::format("at least {}", min) : fmt::format("{} to {}", min, max);
    return fmt::format("settings: {} is {} (expected {})", name, value, range);
  }
  return {};
}

stgs::player::PlayerSettings open_settings_of(const stgs_player_settings& s) {
  stgs::player::PlayerSettings out;
  out.memory_budget = s.memory_budget;
  out.limits = stgs::ReadLimits::of(s.max_primitives, s.max_memory);
  out.max_file_bytes = s.max_file_bytes;
  out.prefetch_seconds = s.prefetch_seconds;
  out.resume_seconds = s.resume_seconds;
  out.layer_lead_seconds = s.layer_lead_seconds;
  out.retry_seconds = s.retry_seconds;
  out.max_reads_in_flight = static_cast<int>(s.max_reads_in_flight);
  out.http.max_attempts = static_cast<int>(s.url_max_attempts);
  out.http.connect_seconds = s.url_connect_seconds;
  out.http.stall_seconds = s.url_stall_seconds;
  out.live.follow = s.live_follow != 0;
  out.live.latency_seconds = s.live_latency_seconds;
  out.live.poll_seconds = s.live_poll_seconds;
  out.live.stall_seconds = s.live_stall_seconds;
  out.live.skip_seconds = s.live_skip_seconds;
  stgs::sdk::read_transfer_settings(s, out.http);
  return out;
}

stgs_player_state state_of(PlayerState state) {
  switch (state) {
    case PlayerState::kPaused:
      return STGS_PLAYER_PAUSED;
    case PlayerState::kPlaying:
      return STGS_PLAYER_PLAYING;
    case PlayerState::kBuffering:
      return STGS_PLAYER_BUFFERING;
    case PlayerState::kEnded:
      break;
  }
  return STGS_PLAYER_ENDED;
}

stgs_event_kind kind_of(PlayerEvent::Kind kind) {
  switch (kind) {
    case PlayerEvent::Kind::kBuffering:
      return STGS_EVENT_BUFFERING;
    case PlayerEvent::Kind::kResumed:
      return STGS_EVENT_RESUMED;
    case PlayerEvent::Kind::kLooped:
      return STGS_EVENT_LOOPED;
    case PlayerEvent::Kind::kEnded:
      return STGS_EVENT_ENDED;
    case PlayerEvent::Kind::kLayers:
      return STGS_EVENT_LAYERS;
    case PlayerEvent::Kind::kRetry:
      return STGS_EVENT_RETRY;
    case PlayerEvent::Kind::kReadFailed:
      return STGS_EVENT_READ_FAILED;
    case PlayerEvent::Kind::kDamaged:
      return STGS_EVENT_DAMAGED;
    case PlayerEvent::Kind::kReplaced:
      return STGS_EVENT_REPLACED;
    case PlayerEvent::Kind::kStalled:
      return STGS_EVENT_STALLED;
    case PlayerEvent::Kind::kSkipped:
      return STGS_EVENT_SKIPPED;
    case PlayerEvent::Kind::kFinished:
      break;
  }
  return STGS_EVENT_FINISHED;
}

}  // namespace

Outcome stgs_player::check_open() const {
  if (player != nullptr) return {};
  return {STGS_ERROR_STATE, "no file is open; open one and wait for it first"};
}

void stgs_player::advance(double now) {
  last_now = now;
  finish_opening(false);
  if (player != nullptr) player->advance(now);
  collect_events();
}

stgs_player_status stgs_player::status() const {
  stgs_player_status out{};
  out.struct_size = sizeof(out);
  if (player == nullptr) {
    out.state = opening.valid() ? STGS_PLAYER_OPENING : STGS_PLAYER_CLOSED;
    return out;
  }
  out.state = state_of(player->state());
  out.seconds = player->seconds();
  out.layers = player->layers();
  out.layer_count = player->layer_count();
  out.ready = player->ready() ? 1 : 0;
  out.is_complete = player->is_complete() ? 1 : 0;
  return out;
}

void stgs_player::push_event(Event event) noexcept {
  event.event.struct_size = sizeof(event.event);
  events.push(std::move(event));
}

void stgs_player::push_event(PlayerEvent& from) {
  Event event;
  event.event.kind = kind_of(from.kind);
  event.event.result = stgs::sdk::result_of(from.code, from.message);
  event.event.seconds = from.seconds;
  const bool is_failure = event.event.result != STGS_OK;
  event.event.offset = is_failure ? from.offset : STGS_NO_OFFSET;
  event.event.layers = from.layers;
  event.message = std::move(from.message);
  push_event(std::move(event));
}

void stgs_player::collect_opening_events() {
  const std::lock_guard lock(opening_mutex);
  for (PlayerEvent& from : opening_events) push_event(from);
  opening_events.clear();
}

void stgs_player::collect_events() {
  collect_opening_events();
  if (player == nullptr) return;
  for (PlayerEvent& from : player->take_events()) push_event(from);
}

extern "C" {

stgs_result stgs_player_settings_defaults(stgs_player_settings* settings, size_t struct_size) {
  return stgs::sdk::fill_defaults(settings, struct_size, default_player_settings());
}

stgs_result stgs_player_create(const stgs_player_settings* settings, stgs_player** out) {
  if (out == nullptr) return STGS_ERROR_ARGUMENT;
  *out = nullptr;
  stgs_player_settings known = default_player_settings();
  if (settings != nullptr) {
    if (const stgs_result bad = stgs::sdk::copy_in(settings, known); bad != STGS_OK) return bad;
  }
  const stgs::sdk::Log log = {known.log, known.log_user};
  if (const stgs_result bad = stgs::sdk::check_task_runner(known.task_runner, log);
      bad != STGS_OK) {
    return bad;
  }
  if (const stgs_result bad = stgs::sdk::check_allocator(known.allocator, log); bad != STGS_OK) {
    return bad;
  }
  try {
    if (const std::string wrong = out_of_range(known); !wrong.empty()) {
      log(STGS_LOG_ERROR, wrong);
      return STGS_ERROR_ARGUMENT;
    }
    auto player = std::make_unique<stgs_player>();
    player->settings = known;
    player->open_settings = open_settings_of(known);
    player->open_settings.memory = stgs::sdk::caller_memory(known.allocator);
    player->tasks = stgs::sdk::caller_tasks(known.task_runner);
    player->open_settings.task_runner = player->tasks.get();
    player->open_settings.http.stop = player->stop.get_token();
    player->open_settings.on_opening_event = [self = player.get()](const PlayerEvent& event) {
      const std::lock_guard lock(self->opening_mutex);
      self->opening_events.push_back(event);
    };
    player->scene.log = log;
    *out = player.release();
    return STGS_OK;
  } catch (const std::bad_alloc&) {
    return STGS_ERROR_OUT_OF_MEMORY;
  }
}

void stgs_player_destroy(stgs_player* player) {
  delete player;
}

stgs_result stgs_player_error(const stgs_player* player, stgs_error* error) {
  return player == nullptr ? STGS_ERROR_ARGUMENT : player->error.get(error);
}

stgs_scene* stgs_player_scene(stgs_player* player) {
  return player == nullptr ? nullptr : &player->scene;
}

stgs_result stgs_player_play(stgs_player* player) {
  return guarded(player, [&]() -> Outcome {
    player->playing = true;
    if (player->player != nullptr) player->player->play();
    return {};
  });
}

stgs_result stgs_player_pause(stgs_player* player) {
  return guarded(player, [&]() -> Outcome {
    player->playing = false;
    if (player->player != nullptr) player->player->pause();
    return {};
  });
}

stgs_result stgs_player_seek(stgs_player* player, double seconds) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(player->check_open());
    return player->player->seek(seconds);
  });
}

stgs_result stgs_player_seek_frame(stgs_player* player, uint32_t frame) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(player->check_open());
    return player->player->seek_frame(frame);
  });
}

stgs_result stgs_player_set_rate(stgs_player* player, double rate) {
  return guarded(player, [&]() -> Outcome {
    if (!(rate >= stgs::player::kMinRate && rate <= stgs::player::kMaxRate) || rate == 0) {
      return {STGS_ERROR_ARGUMENT, fmt::format("rate is {} (expected {} to {}, not 0)", rate,
                                               stgs::player::kMinRate, stgs::player::kMaxRate)};
    }
    if (player->player != nullptr) STGS_SDK_TRY(player->player->set_rate(rate));
    player->rate = rate;
    return {};
  });
}

stgs_result stgs_player_set_loop(stgs_player* player, int32_t loop) {
  return guarded(player, [&]() -> Outcome {
    player->loop = loop != 0;
    if (player->player != nullptr) player->player->set_loop(player->loop);
    return {};
  });
}

stgs_result stgs_player_go_live(stgs_player* player) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(player->check_open());
    player->player->go_live();
    return {};
  });
}

stgs_result stgs_player_get_live(stgs_player* player, stgs_player_live* live) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(stgs::sdk::check_struct(live, "live"));
    stgs::player::LiveState now;
    if (player->player != nullptr) now = player->player->live();
    stgs::sdk::copy_out(
        live, stgs_player_live{sizeof(*live), now.growing ? 1 : 0, now.following ? 1 : 0,
                               now.edge_seconds, now.latency_seconds, now.target_latency_seconds});
    return {};
  });
}

stgs_result stgs_player_update(stgs_player* player, double now, stgs_player_status* status) {
  return guarded(player, [&]() -> Outcome {
    if (!std::isfinite(now))
      return {STGS_ERROR_ARGUMENT, fmt::format("now is {} (expected a finite number)", now)};
    if (status != nullptr) STGS_SDK_TRY(stgs::sdk::check_struct(status, "status"));
    player->advance(now);
    if (status != nullptr) stgs::sdk::copy_out(status, player->status());
    return {};
  });
}

stgs_result stgs_player_get_status(stgs_player* player, stgs_player_status* status) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(stgs::sdk::check_struct(status, "status"));
    stgs::sdk::copy_out(status, player->status());
    return {};
  });
}

stgs_result stgs_player_next_event(stgs_player* player, stgs_player_event* event) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(stgs::sdk::check_struct(event, "event"));
    if (player->events.empty()) player->collect_events();
    if (player->events.empty()) {
      player->last_event = {};
      player->last_event.event.struct_size = sizeof(*event);
      player->last_event.event.offset = STGS_NO_OFFSET;
    } else {
      player->last_event = player->events.pop();
    }
    player->last_event.event.message = player->last_event.message.c_str();
    stgs::sdk::copy_out(event, player->last_event.event);
    return {};
  });
}

stgs_result stgs_player_get_statistics(stgs_player* player, stgs_player_statistics* statistics) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(stgs::sdk::check_struct(statistics, "statistics"));
    stgs::player::StreamStatistics now;
    if (player->player != nullptr) now = player->player->statistics();
    stgs::sdk::copy_out(statistics, {sizeof(*statistics), now.bytes_per_second, now.fetched_bytes,
                                     now.memory_bytes, now.stored_primitives});
    return {};
  });
}

stgs_result stgs_player_get_buffered(stgs_player* player, stgs_time_range* ranges,
                                     uint32_t capacity, uint32_t* count) {
  return guarded(player, [&]() -> Outcome {
    if (count == nullptr) return {STGS_ERROR_ARGUMENT, "count is NULL"};
    if (ranges == nullptr && capacity > 0) return {STGS_ERROR_ARGUMENT, "ranges is NULL"};
    std::vector<stgs::player::TimeRange> buffered;
    if (player->player != nullptr) buffered = player->player->buffered();
    const std::size_t fit = std::min<std::size_t>(capacity, buffered.size());
    for (std::size_t i = 0; i < fit; ++i) ranges[i] = {buffered[i].begin, buffered[i].end};
    *count = static_cast<std::uint32_t>(buffered.size());
    return {};
  });
}

}  // extern "C"
