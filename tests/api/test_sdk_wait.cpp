// SPDX-License-Identifier: Apache-2.0
// Waiting until a time of a player is complete.
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kSeconds = 1.9;  // far from the start of clip_file()
constexpr double kLong = 60;      // for a busy machine

stgs_player_status empty_status() {
  stgs_player_status status{};
  status.struct_size = sizeof status;
  return status;
}

// Fetches little ahead, so that kSeconds is missing at first.
stgs_player_settings short_sighted() {
  stgs_player_settings settings = player_settings();
  settings.prefetch_seconds = settings.resume_seconds = 0.1;
  settings.max_reads_in_flight = 1;
  return settings;
}

}  // namespace

TEST_CASE("a player seeks and waits until the time is complete", "[sdk]") {
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
  const stgs_view view = [] {
    stgs_view out;
    REQUIRE(stgs_view_defaults(&out, sizeof out) == STGS_OK);
    REQUIRE(stgs_view_resize(&out, kSdkWidth, kSdkHeight) == STGS_OK);
    return out;
  }();
  const RendererPtr renderer = cpu_renderer();
  const ScenePtr scene = open_scene(clip_file());
  CHECK(draw_rgba8(renderer.get(), stgs_player_scene(player.get()), 0.5, view) ==
        draw_rgba8(renderer.get(), scene.get(), 0.5, view));
  // Its clock continues: the next update of an application in real time is no step.
  CHECK(update(player.get(), 1e9).seconds == Approx(0.5));
}

TEST_CASE("waiting ends with the time-out, and can go on later", "[sdk]") {
  CallerFile file(clip_file());
  const stgs_async_io io = file.async_io();
  const stgs_player_settings settings = short_sighted();
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
  // It looks once where it may not wait.
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, 0, &status) == STGS_ERROR_TIMEOUT);
  file.stall_from = 1 << 30;
  file.answer();
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, kLong, &status) == STGS_OK);
  CHECK(status.layers == status.layer_count);
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, 0, &status) == STGS_OK);
}

TEST_CASE("what cannot be read is not waited for", "[sdk]") {
  CallerFile file(clip_file());
  file.error_from = head_bytes_of(clip_file());
  file.error = 9;
  const stgs_io io = file.io();
  const stgs_player_settings settings = short_sighted();
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_player_status status = empty_status();
  CHECK(stgs_player_seek_and_wait(player.get(), kSeconds, kLong, &status) == STGS_OK);
  CHECK(status.is_complete == 1);
  CHECK(status.ready == 0);
  const auto events = take_events(player.get());
  CHECK(std::any_of(events.begin(), events.end(), [](const KeptEvent& event) {
    return event.event.kind == STGS_EVENT_READ_FAILED;
  }));
}

TEST_CASE("waiting takes an open file and a time", "[sdk]") {
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
