// SPDX-License-Identifier: Apache-2.0
// Opens the file of a player in the background.
#include <chrono>
#include <new>
#include <utility>

#include "player.h"
#include "source.h"
#include "stgs/player/source.h"
#include "structs.h"

using stgs::player::Player;
using stgs::sdk::guarded;
using stgs::sdk::Outcome;

namespace {

constexpr const char* kOutOfMemory = "out of memory";  // short enough not to allocate

Outcome check_closed(const stgs_player& player) {
  if (player.opening.valid()) return {STGS_ERROR_STATE, "a file is already being opened"};
  if (player.player == nullptr) return {};
  return {STGS_ERROR_STATE, "the player already has a file; create another player"};
}

// Takes ownership of the caller's source, whose struct has been checked.
template <typename Io>
void open_caller_source(stgs_player& player, const Io& io) {
  stgs::sdk::CallerSource caller = stgs::sdk::callback_source(io);
  // Shared, because std::function requires copyable captures.
  const auto source = std::make_shared<std::unique_ptr<stgs::ByteSource>>(std::move(caller.source));
  using Opened = stgs_player::Opened;
  player.begin_opening(
      [source, interrupt = caller.interrupt, settings = player.open_settings]() -> Opened {
        STGS_TRY((*source)->refresh(0).status());  // queries the size; may block
        return Player::from_source(std::move(*source), settings, interrupt);
      });
  player.interrupt = std::move(caller.interrupt);
}

stgs_result open_bytes(stgs_player* player, const void* data, std::size_t bytes, bool copy) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    if (data == nullptr) return {STGS_ERROR_ARGUMENT, "data is NULL"};
    const auto* begin = static_cast<const std::uint8_t*>(data);
    // A file that is too large is rejected while opening; do not copy it.
    copy = copy && bytes <= player->open_settings.max_file_bytes;
    const auto source = std::make_shared<std::unique_ptr<stgs::ByteSource>>(
        copy ? stgs::sdk::copied_source({begin, bytes}, player->open_settings.memory)
             : stgs::sdk::borrowed_source({begin, bytes}));
    player->begin_opening([source, settings = player->open_settings] {
      return Player::from_source(std::move(*source), settings);
    });
    return {};
  });
}

}  // namespace

stgs_player::stgs_player() {
  scene.of_player = true;
}

stgs_player::~stgs_player() {
  stop.request_stop();
  if (interrupt) interrupt();
  if (opening.valid()) opening.wait();
  scene.timeline = nullptr;
}

void stgs_player::begin_opening(std::function<Opened()> open) {
  opened = {};
  has_opened = false;
  opening = std::async(std::launch::async, std::move(open));
}

// Takes the player from an opening that has ended.
Outcome stgs_player::take_opened() {
  try {
    Opened result = opening.get();
    if (!result.ok()) return result.status();
    STGS_SDK_TRY((*result)->set_rate(rate));
    (*result)->set_loop(loop);
    if (playing) (*result)->play();
    player = std::move(result).value();
    scene.timeline = &player->timeline();
    return {};
  } catch (const std::bad_alloc&) {
    return {STGS_ERROR_OUT_OF_MEMORY, kOutOfMemory};
  } catch (const std::exception& e) {
    return {STGS_ERROR_RUNTIME, fmt::format("the file could not be opened: {}", e.what())};
  }
}

void stgs_player::finish_opening(bool wait) {
  if (!opening.valid()) return;
  if (!wait && opening.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  opened = take_opened();
  has_opened = true;
  collect_opening_events();
  const bool ok = opened.result == STGS_OK;
  if (!ok) interrupt = nullptr;  // closes the caller's source
  stgs::sdk::LastError opening_error;
  opening_error.set(opened);
  stgs_error error_details{};
  error_details.struct_size = sizeof(error_details);
  opening_error.get(&error_details);
  Event event;
  event.event.kind = ok ? STGS_EVENT_OPENED : STGS_EVENT_FAILED;
  event.event.result = error_details.result;
  event.event.offset = error_details.offset;
  try {
    event.message = error_details.message;
  } catch (const std::bad_alloc&) {
    event.message = kOutOfMemory;
  }
  push_event(std::move(event));
  if (ok) {
    push_opening_damage();
  } else {
    scene.log(STGS_LOG_ERROR, opened.status.message());
  }
}

void stgs_player::push_opening_damage() {
  scene.log_issues();
  int pushed = 0;
  for (const stgs::Issue& issue : scene.timeline->damage()) {
    if (!issue.error || pushed == STGS_MAX_OPENING_DAMAGE) continue;
    ++pushed;
    Event event;
    event.event.kind = STGS_EVENT_DAMAGED;
    event.event.result = STGS_ERROR_INVALID_FILE;
    event.event.offset = issue.offset;
    try {
      event.message = fmt::format("{}: {}", scene.timeline->name(), issue.message);
    } catch (const std::bad_alloc&) {
      event.message = kOutOfMemory;
    }
    push_event(std::move(event));
  }
}

extern "C" {

stgs_result stgs_player_open(stgs_player* player, const char* location) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    if (location == nullptr) return {STGS_ERROR_ARGUMENT, "location is NULL"};
    player->begin_opening([path = std::string(location), settings = player->open_settings] {
      return Player::open(path, settings);
    });
    return {};
  });
}

stgs_result stgs_player_open_memory(stgs_player* player, const void* data, size_t bytes) {
  return open_bytes(player, data, bytes, false);
}

stgs_result stgs_player_open_memory_copy(stgs_player* player, const void* data, size_t bytes) {
  return open_bytes(player, data, bytes, true);
}

stgs_result stgs_player_open_io(stgs_player* player, const stgs_io* io) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    stgs_io known{};
    STGS_SDK_TRY(stgs::sdk::copy_in(io, known, "io"));
    if (known.read == nullptr) return {STGS_ERROR_ARGUMENT, "io->read is NULL"};
    open_caller_source(*player, known);
    return {};
  });
}

stgs_result stgs_player_open_async_io(stgs_player* player, const stgs_async_io* io) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    stgs_async_io known{};
    STGS_SDK_TRY(stgs::sdk::copy_in(io, known, "io"));
    if (known.begin == nullptr) return {STGS_ERROR_ARGUMENT, "io->begin is NULL"};
    open_caller_source(*player, known);
    return {};
  });
}

stgs_result stgs_player_wait_open(stgs_player* player) {
  return guarded(player, [&]() -> Outcome {
    player->finish_opening(true);
    if (!player->has_opened)
      return {STGS_ERROR_STATE, "no file is being opened; call a stgs_player_open function first"};
    return player->opened;
  });
}

}  // extern "C"
