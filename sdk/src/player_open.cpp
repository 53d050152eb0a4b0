// SPDX-License-Identifier: Apache-2.0
// Opening a player's file, while the application goes on.
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

constexpr const char* kNoMemory = "no memory";  // short enough for a string to take none

Outcome check_closed(const stgs_player& player) {
  if (player.opening.valid()) return {STGS_ERROR_STATE, "a file is being opened already"};
  if (player.player == nullptr) return {};
  return {STGS_ERROR_STATE, "the player has a file already: make another one"};
}

// A source of the caller's with its struct checked; then it is the player's.
template <typename Io>
void open_caller_source(stgs_player& player, const Io& io) {
  stgs::sdk::CallerSource caller = stgs::sdk::callback_source(io);
  // A function can be copied, a unique_ptr cannot.
  const auto source = std::make_shared<std::unique_ptr<stgs::ByteSource>>(std::move(caller.source));
  using Opened = stgs_player::Opened;
  player.begin_opening([source, interrupt = caller.interrupt, wanted = player.wanted]() -> Opened {
    STGS_TRY((*source)->refresh(0).status());  // how large it is, which may take its time
    return Player::from_source(std::move(*source), wanted, interrupt);
  });
  player.interrupt = std::move(caller.interrupt);
}

stgs_result open_bytes(stgs_player* player, const void* data, std::size_t bytes, bool copy) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    if (data == nullptr) return {STGS_ERROR_ARGUMENT, "data is NULL"};
    const auto* begin = static_cast<const std::uint8_t*>(data);
    // What is too large is refused in the opening, and needs no copy for that.
    copy = copy && bytes <= player->wanted.max_file_bytes;
    const auto source = std::make_shared<std::unique_ptr<stgs::ByteSource>>(
        copy ? stgs::sdk::copied_source({begin, bytes}, player->wanted.memory)
             : stgs::sdk::borrowed_source({begin, bytes}));
    player->begin_opening([source, wanted = player->wanted] {
      return Player::from_source(std::move(*source), wanted);
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
  has_ended = false;
  opening = std::async(std::launch::async, std::move(open));
}

// The player of an opening that has ended.
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
    return {STGS_ERROR_OUT_OF_MEMORY, kNoMemory};
  } catch (const std::exception& e) {
    return {STGS_ERROR_RUNTIME, fmt::format("the file could not be opened: {}", e.what())};
  }
}

void stgs_player::note_opened(bool wait) {
  if (!opening.valid()) return;
  if (!wait && opening.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
  opened = take_opened();
  has_ended = true;
  take_opening_events();
  const bool ok = opened.result == STGS_OK;
  if (!ok) interrupt = nullptr;  // closes a source of the caller's
  stgs::sdk::LastError error_of_opening;
  error_of_opening.set(opened);
  stgs_error in_words{};
  in_words.struct_size = sizeof(in_words);
  error_of_opening.tell(&in_words);
  Event event;
  event.event.kind = ok ? STGS_EVENT_OPENED : STGS_EVENT_FAILED;
  event.event.result = in_words.result;
  event.event.offset = in_words.offset;
  try {
    event.message = in_words.message;
  } catch (const std::bad_alloc&) {
    event.message = kNoMemory;
  }
  tell(std::move(event));
  if (ok) {
    tell_damage();
  } else {
    scene.log(STGS_LOG_ERROR, opened.status.message());
  }
}

void stgs_player::tell_damage() {
  scene.tell_damage();
  int told_so_far = 0;
  for (const stgs::Issue& issue : scene.timeline->damage()) {
    if (!issue.error || told_so_far == STGS_MAX_OPENING_DAMAGE) continue;
    ++told_so_far;
    Event event;
    event.event.kind = STGS_EVENT_DAMAGED;
    event.event.result = STGS_ERROR_INVALID_FILE;
    event.event.offset = issue.offset;
    try {
      event.message = fmt::format("{}: {}", scene.timeline->name(), issue.message);
    } catch (const std::bad_alloc&) {
      event.message = kNoMemory;
    }
    tell(std::move(event));
  }
}

extern "C" {

stgs_result stgs_player_open(stgs_player* player, const char* place) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    if (place == nullptr) return {STGS_ERROR_ARGUMENT, "place is NULL"};
    player->begin_opening([path = std::string(place), wanted = player->wanted] {
      return Player::open(path, wanted);
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
    STGS_SDK_TRY(stgs::sdk::take_struct(io, known, "io"));
    if (known.read == nullptr) return {STGS_ERROR_ARGUMENT, "io->read is NULL"};
    open_caller_source(*player, known);
    return {};
  });
}

stgs_result stgs_player_open_async_io(stgs_player* player, const stgs_async_io* io) {
  return guarded(player, [&]() -> Outcome {
    STGS_SDK_TRY(check_closed(*player));
    stgs_async_io known{};
    STGS_SDK_TRY(stgs::sdk::take_struct(io, known, "io"));
    if (known.begin == nullptr) return {STGS_ERROR_ARGUMENT, "io->begin is NULL"};
    open_caller_source(*player, known);
    return {};
  });
}

stgs_result stgs_player_wait_open(stgs_player* player) {
  return guarded(player, [&]() -> Outcome {
    player->note_opened(true);
    if (!player->has_ended) return {STGS_ERROR_STATE, "no file is being opened"};
    return player->opened;
  });
}

}  // extern "C"
