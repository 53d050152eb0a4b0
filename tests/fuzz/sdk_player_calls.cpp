// SPDX-License-Identifier: Apache-2.0
// Calls of the target sdk on players.
#include <chrono>
#include <cmath>
#include <iterator>
#include <thread>

#include "sdk_calls.h"

namespace stgs::fuzz {

stgs_result SdkCalls::create_player(std::uint8_t argument) {
  using Settings = stgs_player_settings;
  constexpr double Settings::*kSeconds[] = {
      &Settings::prefetch_seconds,    &Settings::resume_seconds,
      &Settings::layer_lead_seconds,  &Settings::retry_seconds,
      &Settings::live_poll_seconds,   &Settings::live_latency_seconds,
      &Settings::live_stall_seconds,  &Settings::live_skip_seconds,
      &Settings::url_stall_seconds,   &Settings::url_connect_seconds,
      &Settings::url_timeout_seconds, &Settings::url_min_bytes_per_second};
  Settings settings;
  stgs_player_settings_defaults(&settings, sizeof settings);
  settings.memory_budget = settings.max_memory = (argument & 1) != 0 ? 1 << 20 : 64 << 20;
  settings.max_reads_in_flight = (argument & 2) != 0 ? 3 : 1;
  settings.live_follow = (argument & 4) != 0 ? 0 : 1;
  settings.live_poll_seconds = settings.live_stall_seconds = 0;
  settings.allocator = allocator();
  settings.task_runner = runner();
  settings.log = log();
  if (extreme_setting != 0) {
    settings.*kSeconds[extreme_setting / 8 % std::size(kSeconds)] = extreme_number(extreme_setting);
  }
  destroy_player();
  if ((argument & 8) == 0) return stgs_player_create(&settings, &player);
  return stgs_player_create(ResizedStruct(settings, argument / 16).get(), &player);
}

// Opens bytes or a source.
stgs_result SdkCalls::open_player(std::uint8_t argument) {
  stgs_player_status status{};
  status.struct_size = sizeof status;
  if (stgs_player_update(player, now, &status) != STGS_OK) return STGS_ERROR_ARGUMENT;
  if (status.state != STGS_PLAYER_CLOSED) return stgs_player_open(player, "x");
  if (argument >= 0x80) return open_player_source(argument);
  player_bytes = some_file(argument);
  return (argument & 0x40) != 0
             ? stgs_player_open_memory_copy(player, player_bytes.data(), player_bytes.size())
             : stgs_player_open_memory(player, player_bytes.data(), player_bytes.size());
}

stgs_result SdkCalls::open_player_source(std::uint8_t argument) {
  auto source = make_source(argument);
  stgs_result result = STGS_OK;
  if ((argument & 0x40) != 0) {
    const stgs_async_io io = source->async_io();
    result = stgs_player_open_async_io(player, &io);
  } else {
    const stgs_io io = source->io();
    result = stgs_player_open_io(player, &io);
  }
  if (result == STGS_OK) player_sources.push_back(std::move(source));
  return result;
}

// Does not wait for deferred sources: their reads complete only in other calls, so it would never
// return.
stgs_result SdkCalls::wait_open() const {
  const bool deferred = !player_sources.empty() && player_sources.back()->is_deferred();
  return deferred ? STGS_ERROR_STATE : stgs_player_wait_open(player);
}

stgs_result SdkCalls::control(std::uint8_t argument) {
  switch (argument % 7) {
    case 0:
      return stgs_player_play(player);
    case 1:
      return stgs_player_pause(player);
    case 2:
      return stgs_player_seek(player, extreme_number(argument >> 5));
    case 3:
      return stgs_player_seek_frame(player, argument >> 4);
    case 4:
      return stgs_player_set_rate(player, extreme_number(argument >> 5));
    case 5:
      return stgs_player_go_live(player);
    default:
      return stgs_player_set_loop(player, argument >> 7);
  }
}

stgs_result SdkCalls::update_player(std::uint8_t argument) {
  now += 0.03;
  const double seconds = (argument & 0x80) != 0 ? now + extreme_number(argument) : now;
  stgs_player_status status{};
  status.struct_size = sizeof status + (argument == 255 ? 1 : 0);
  const stgs_result result = stgs_player_update(player, seconds, &status);
  if (result == STGS_OK) {
    require(status.layers >= 0 && status.layers <= status.layer_count,
            "the loaded layers are layers of the file");
    require(std::isfinite(status.seconds) && status.seconds >= 0,
            "the position is a time of the clip");
  }
  stgs_player_event event{};
  event.struct_size = sizeof event;
  events = 0;
  while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE) {
    require((event.result == STGS_OK) == (event.message[0] == '\0'),
            "an event of an error has a message");
    ++events;
  }
  query_player(argument);
  return result;
}

// Gives the threads of the player up to 20 ms; returns after an event or when a read is pending.
stgs_result SdkCalls::wait_player() {
  stgs_result result = STGS_OK;
  for (int k = 0; k < 20 && !player_sources.empty() && !player_sources.back()->has_pending_reads();
       ++k) {
    result = update_player(0);
    if (events > 0) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return result;
}

void SdkCalls::query_player(std::uint8_t argument) const {
  stgs_player_live live{};
  live.struct_size = sizeof live;
  if (stgs_player_get_live(player, &live) == STGS_OK) {
    require(live.growing != 0 || live.edge_seconds == 0, "only a growing scene has a live edge");
    require(std::isfinite(live.edge_seconds) && std::isfinite(live.latency_seconds),
            "the live edge and the latency are finite");
  }
  stgs_player_status status{};
  status.struct_size = sizeof status;
  if (stgs_player_get_status(player, &status) == STGS_OK) {
    require(std::isfinite(status.seconds) && status.seconds >= 0,
            "the position is a time of the clip");
  }
  stgs_player_statistics statistics{};
  statistics.struct_size = sizeof statistics;
  (void)stgs_player_get_statistics(player, &statistics);
  stgs_time_range ranges[2];
  std::uint32_t count = 0;
  (void)stgs_player_get_buffered(player, ranges, argument % 3, &count);
}

// Replaces the bytes of the sources by another file, or changes one bit.
void SdkCalls::replace_source_bytes(std::uint8_t argument) {
  Bytes bytes = recording().bytes;
  if ((argument & 0x80) != 0) {
    bytes = some_file(argument);
  } else {
    bytes[bytes.size() * argument / 128] ^= 1;
  }
  for (const auto& source : player_sources) source->replace_bytes(bytes);
}

// Sets the reported size to the end of a fragment or to another size.
void SdkCalls::resize_sources(std::uint8_t argument) {
  const auto& ends = recording().ends;
  const std::uint64_t size =
      argument < 0x80 ? ends[argument % ends.size()] : ends.back() * (argument - 0x80u) / 0x70;
  for (const auto& source : player_sources) source->resize(size);
}

void SdkCalls::destroy_player() {
  stgs_player_destroy(player);
  player = nullptr;
  release_sources(player_sources);
}

}  // namespace stgs::fuzz
