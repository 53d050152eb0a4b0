// SPDX-License-Identifier: Apache-2.0
// Errors of the player of the C API: failed opens, limits, rejected settings, damage and stalls.
#include <limits>

#include "fixtures/copy_fixture.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {

TEST_CASE("a failed open is reported, and the player can open another file", "[sdk]") {
  std::string logged;
  stgs_player_settings settings = player_settings();
  settings.log_user = &logged;
  settings.log = [](void* user, stgs_log_level, const char* message) {
    *static_cast<std::string*>(user) += message;
  };
  const PlayerPtr player = make_player(&settings);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_STATE);
  CHECK(stgs_player_open(player.get(), nullptr) == STGS_ERROR_ARGUMENT);
  REQUIRE(stgs_player_open(player.get(), "/nowhere/none.stgs") == STGS_OK);
  REQUIRE(update_until(player.get(), 0, [](const stgs_player_status& status) {
    return status.state == STGS_PLAYER_CLOSED;
  }));
  auto events = take_events(player.get());
  REQUIRE(events.size() == 1);
  CHECK(events[0].event.kind == STGS_EVENT_FAILED);
  CHECK(events[0].event.result == STGS_ERROR_IO);
  CHECK(contains(events[0].message, "/nowhere/none.stgs: cannot open"));
  CHECK(contains(logged, "/nowhere/none.stgs: cannot open"));
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_IO);
  CHECK(contains(error_of(player.get()).message, "/nowhere/none.stgs"));

  auto damaged = without_copy(clip_file());
  damaged[20] ^= 1;
  REQUIRE(stgs_player_open_memory(player.get(), damaged.data(), damaged.size()) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_INVALID_FILE);
  CHECK(error_of(player.get()).issue == 103);
  events = take_events(player.get());
  REQUIRE(events.size() == 1);
  CHECK(events[0].event.offset != STGS_NO_OFFSET);

  FaultySource file(clip_file());
  file.error = 42;
  stgs_async_io io = file.async_io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_IO);
  const std::string message = error_of(player.get()).message;
  CHECK(contains(message, "failed with error 42"));
  CHECK(message.rfind("application source:") == 0);  // the prefix occurs once
  CHECK(file.closed == 1);
  io.begin = nullptr;
  CHECK(stgs_player_open_async_io(player.get(), &io) == STGS_ERROR_ARGUMENT);
  CHECK(file.closed == 1);

  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_OK);
  CHECK(stgs_player_open(player.get(), "x") == STGS_ERROR_STATE);
  CHECK(stgs_player_seek_frame(player.get(), kClipFrames) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_seek(player.get(), std::numeric_limits<double>::quiet_NaN()) ==
        STGS_ERROR_ARGUMENT);
}

TEST_CASE("retries of a failed open are reported before the failure", "[sdk]") {
  stgs_player_settings settings = player_settings();
  settings.url_max_attempts = 3;
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open(player.get(), "http://127.0.0.1:1/nobody.stgs") == STGS_OK);
  std::vector<int> kinds;
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status& status) {
    for (const auto& one : take_events(player.get())) kinds.push_back(one.event.kind);
    return status.state == STGS_PLAYER_CLOSED;
  }));
  for (const auto& one : take_events(player.get())) kinds.push_back(one.event.kind);
  // Without URL support, the player reports an error other than STGS_ERROR_IO.
  const bool fetches = stgs_player_wait_open(player.get()) == STGS_ERROR_IO;
  const int retry = STGS_EVENT_RETRY, failed = STGS_EVENT_FAILED;
  CHECK(kinds == (fetches ? std::vector{retry, retry, failed} : std::vector{failed}));
}

TEST_CASE("a file above a limit of the player fails to open", "[sdk]") {
  stgs_player_settings settings = player_settings();
  SECTION("bytes") {
    settings.max_file_bytes = clip_file().size() - 1;
  }
  SECTION("primitives") {
    settings.max_primitives = 100;
  }
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_LIMIT);
  CHECK(contains(error_of(player.get()).message, "limit"));
  stgs_player* none = nullptr;
  settings = player_settings();
  settings.max_reads_in_flight = 0;
  CHECK(stgs_player_create(&settings, &none) == STGS_ERROR_ARGUMENT);
  settings = player_settings();
  settings.struct_size -= 4;
  CHECK(stgs_player_create(&settings, &none) == STGS_ERROR_STRUCT_SIZE);
  CHECK(none == nullptr);
}

TEST_CASE("a source larger than max_file_bytes is closed without a read", "[sdk]") {
  FaultySource file(clip_file());
  stgs_player_settings settings = player_settings();
  settings.max_file_bytes = clip_file().size() - 1;
  const PlayerPtr player = make_player(&settings);
  SECTION("callbacks") {
    const stgs_io io = file.io();
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
  }
  SECTION("asynchronous callbacks") {
    const stgs_async_io io = file.async_io();
    REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  }
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_LIMIT);
  CHECK(file.reads == 0);
  CHECK(file.closed == 1);
}

TEST_CASE("a player does not copy memory larger than max_file_bytes", "[sdk]") {
  stgs_player_settings settings = player_settings();
  settings.max_file_bytes = 100;
  // The pointer is valid; the lengths exceed any memory.
  for (const std::size_t bytes : {std::size_t{1} << 46, std::numeric_limits<std::size_t>::max()}) {
    const PlayerPtr player = make_player(&settings);
    REQUIRE(stgs_player_open_memory_copy(player.get(), clip_file().data(), bytes) == STGS_OK);
    CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_LIMIT);
  }
}

TEST_CASE("damage found while opening is reported after the opened event", "[sdk]") {
  auto bytes = clip_file();
  bytes.resize(bytes.size() * 2 / 3);
  const PlayerPtr player = open_player(bytes);
  const std::vector<OwnedEvent> events = take_events(player.get());
  REQUIRE(events.size() >= 2);
  CHECK(events[0].event.kind == STGS_EVENT_OPENED);
  CHECK(events[1].event.kind == STGS_EVENT_DAMAGED);
  CHECK(events[1].event.result == STGS_ERROR_INVALID_FILE);
  CHECK(events[1].event.offset <= bytes.size());
  CHECK_FALSE(events[1].message.empty());
  CHECK(count_events(events, STGS_EVENT_DAMAGED) <= STGS_MAX_OPENING_DAMAGE);
  const PlayerPtr intact = open_player(clip_file());
  CHECK(count_events(take_events(intact.get()), STGS_EVENT_DAMAGED) == 0);
}

TEST_CASE("the log names the rejected setting", "[sdk]") {
  std::string logged;
  const auto store = [](void* user, stgs_log_level, const char* message) {
    *static_cast<std::string*>(user) = message;
  };
  stgs_player_settings settings;
  REQUIRE(stgs_player_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.log = store;
  settings.log_user = &logged;
  settings.url_max_attempts = 5000;
  stgs_player* player = nullptr;
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(logged == "settings: url_max_attempts is 5000 (expected 1 to 1000)");
  settings.url_max_attempts = 5;
  settings.prefetch_seconds = -1;
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(logged == "settings: prefetch_seconds is -1 (expected at least 0)");
  settings.prefetch_seconds = 1;
  stgs_task_runner runner{};
  runner.struct_size = sizeof runner;
  settings.task_runner = &runner;
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(logged == "settings: task_runner has no `run`");
  settings.task_runner = nullptr;
  settings.retry_seconds = std::numeric_limits<double>::quiet_NaN();
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(logged == "settings: retry_seconds is nan (expected at least 0)");
  CHECK(player == nullptr);
}

TEST_CASE("damage and read errors during playback are reported with their offset", "[sdk]") {
  auto reader = SceneReader::open(memory_source(clip_file()));
  REQUIRE(reader.ok());
  const SegmentInfo& base = (*reader)->segments().front();
  auto bytes = clip_file();
  bytes[base.offset + base.bytes / 2] ^= 1;
  const PlayerPtr damaged = open_player(bytes);
  REQUIRE(wait_until_complete(damaged.get(), 0));
  bool reported = false;
  for (const OwnedEvent& one : take_events(damaged.get())) {
    if (one.event.kind != STGS_EVENT_DAMAGED) continue;
    reported = one.event.offset == base.offset && one.event.result == STGS_ERROR_INVALID_FILE &&
               !one.message.empty();
  }
  CHECK(reported);

  FaultySource file(clip_file());
  file.error = 7;
  file.error_from = head_bytes_of(clip_file());
  const stgs_io io = file.io();
  const PlayerPtr player = make_player();
  REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  std::vector<OwnedEvent> read_failures;
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status&) {
    for (OwnedEvent& one : take_events(player.get())) {
      if (one.event.kind == STGS_EVENT_READ_FAILED) read_failures.push_back(std::move(one));
    }
    return !read_failures.empty();
  }));
  CHECK(read_failures[0].event.result == STGS_ERROR_IO);
  CHECK(read_failures[0].event.offset >= file.error_from);
  CHECK(contains(read_failures[0].message, "failed with error 7"));
}

TEST_CASE("a player can be destroyed while any of its reads stalls", "[sdk]") {
  FaultySource reference(clip_file());
  {
    const PlayerPtr player = make_player();
    const stgs_io io = reference.io();
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
    REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    REQUIRE(wait_until_complete(player.get(), 0));
  }
  REQUIRE(reference.reads > 3);
  for (const bool async : {false, true}) {
    for (int from = 0; from < reference.reads; ++from) {
      FaultySource file(clip_file());
      file.stall_from = from;
      PlayerPtr player = make_player();
      const stgs_io io = file.io();
      const stgs_async_io async_io = file.async_io();
      REQUIRE((async ? stgs_player_open_async_io(player.get(), &async_io)
                     : stgs_player_open_io(player.get(), &io)) == STGS_OK);
      REQUIRE(stgs_player_play(player.get()) == STGS_OK);
      REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status& status) {
        return file.reads > from || status.is_complete != 0;
      }));
      player.reset();
      CHECK(file.interrupted == 1);
      const bool has_pending = async && file.pending() > 0;
      CHECK(file.closed == (has_pending ? 0 : 1));
      file.complete(from % 2);  // after the player is destroyed
      CHECK(file.closed == 1);
    }
  }
}

}  // namespace stgs::testing
