// SPDX-License-Identifier: Apache-2.0
// Waiting until the current time of a player is complete.
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kSeconds = 1.9;  // far from the start of clip_file()
constexpr double kLong = 60;      // seconds; generous for a busy machine

stgs_player_status empty_status() {
  stgs_player_status status{};
  status.struct_size = sizeof status;
  return status;
}

// Prefetches little, so that kSeconds is missing at first.
stgs_player_settings short_prefetch_settings() {
  stgs_player_settings settings = player_settings();
  settings.prefetch_seconds = settings.resume_seconds = 0.1;
  settings.max_reads_in_flight = 1;
  return settings;
}

}  // namespace

TEST_CASE("seek_and_wait returns once the time is complete", "[sdk]") {
  const PlayerPtr player = open_player(clip_file());
  REQUIRE(stgs_player_set_rate(player.get(), 2) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  stgs_player_status status = empty_status();
  for (const double seconds : {kSeconds, 0.3, 99.0}) {
    INFO(seconds << " s");
    REQUIRE(stgs_player_seek_and_wait(player.get(), seconds, kLong, &status) == STGS_OK);
    CHECK(status.state == STGS_PLAYER_PAUSED);
    CHECK(status.seconds == Approx(std::min(seconds, (kClipFrames - 1) / 30.0)));
    CHECK(status.is_complete == 1);
    CHECK(status.layers == status.layer_count);
  }
  REQUIRE(stgs_player_seek_and_wait(player.get(), 0.5, INFINITY, nullptr) == STGS_OK);
  const stgs_view view = small_view();
  const RendererPtr renderer = cpu_renderer();
  const ScenePtr scene = open_scene(clip_file());
  CHECK(render_rgba8(renderer.get(), stgs_player_scene(player.get()), 0.5, view) ==
        render_rgba8(renderer.get(), scene.get(), 0.5, view));
  // The next update does not advance the player, whatever time the application passes.
  CHECK(update(player.get(), 1e9).seconds == Approx(0.5));
}

TEST_CASE("seek_and_wait times out and can be repeated", "[sdk]") {
  FaultySource file(clip_file());
  const stgs_async_io io = file.async_io();
  const stgs_player_settings settings = short_prefetch_settings();
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  file.stall_from = 0;
  stgs_player_status status = empty_status();
  const auto begin = std::chrono::steady_clock::now();
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, 0.05, &status) == STGS_ERROR_TIMEOUT);
  const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - begin;
  CHECK(waited.count() >= 0.05);
  CHECK(status.seconds == Approx(kSeconds));
  CHECK(status.is_complete == 0);
  CHECK(std::string(error_of(player.get()).message).find("1.9 s") != std::string::npos);
  CHECK(std::string(stgs_result_name(STGS_ERROR_TIMEOUT)) == "STGS_ERROR_TIMEOUT");
  // A timeout of 0 checks once.
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, 0, &status) == STGS_ERROR_TIMEOUT);
  file.stall_from = 1 << 30;
  file.complete();
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, kLong, &status) == STGS_OK);
  CHECK(status.layers == status.layer_count);
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, 0, &status) == STGS_OK);
}

TEST_CASE("seek_and_wait does not wait for reads that fail", "[sdk]") {
  FaultySource file(clip_file());
  file.error_from = head_bytes_of(clip_file());
  file.error = 9;
  const stgs_io io = file.io();
  const stgs_player_settings settings = short_prefetch_settings();
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_player_status status = empty_status();
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, kLong, &status) == STGS_OK);
  CHECK(status.is_complete == 1);
  CHECK(status.ready == 0);
  const auto events = take_events(player.get());
  CHECK(std::any_of(events.begin(), events.end(), [](const OwnedEvent& event) {
    return event.event.kind == STGS_EVENT_READ_FAILED;
  }));
}

TEST_CASE("seek_and_wait rejects a closed player and invalid arguments", "[sdk]") {
  stgs_player_status status = empty_status();
  CHECK(stgs_player_seek_and_wait(nullptr, 0, 1, &status) == STGS_ERROR_ARGUMENT);
  const PlayerPtr closed = make_player();
  CHECK(stgs_player_seek_and_wait(closed.get(), 0, 1, &status) == STGS_ERROR_STATE);
  const PlayerPtr player = open_player(clip_file());
  CHECK(stgs_player_seek_and_wait(player.get(), NAN, 1, &status) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_seek_and_wait(player.get(), 0, -1, &status) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_seek_and_wait(player.get(), 0, NAN, &status) == STGS_ERROR_ARGUMENT);
  status.struct_size = 12;
  CHECK(stgs_player_seek_and_wait(player.get(), 0, 1, &status) == STGS_ERROR_STRUCT_SIZE);
}

}  // namespace stgs::testing
