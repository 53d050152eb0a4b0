// SPDX-License-Identifier: Apache-2.0
// The player of the C API: sources, playback, statistics and threads.
#include <filesystem>
#include <fstream>

#include "fixtures/temporary_folder.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

std::vector<std::uint8_t> expected_image(double seconds) {
  const ScenePtr scene = open_scene(clip_file());
  return render_rgba8(cpu_renderer().get(), scene.get(), seconds, small_view());
}

}  // namespace

TEST_CASE("a player renders the same image as a scene from every kind of source", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "clip.stgs";
  FaultySource file(clip_file());
  PlayerPtr player = make_player();
  stgs_result opened = STGS_OK;
  SECTION("a path") {
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(clip_file().data()),
               static_cast<std::streamsize>(clip_file().size()));
    opened = stgs_player_open(player.get(), path.c_str());
  }
  SECTION("memory") {
    opened = stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size());
  }
  SECTION("a copy") {
    auto temporary = std::make_unique<std::vector<std::uint8_t>>(clip_file());
    opened = stgs_player_open_memory_copy(player.get(), temporary->data(), temporary->size());
  }
  SECTION("callbacks") {
    const stgs_io io = file.io();
    opened = stgs_player_open_io(player.get(), &io);
  }
  SECTION("asynchronous callbacks that complete at once") {
    const stgs_async_io io = file.async_io();
    opened = stgs_player_open_async_io(player.get(), &io);
  }
  REQUIRE(opened == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  std::filesystem::remove(path);
  const RendererPtr renderer = cpu_renderer();
  for (const std::uint32_t frame : {0u, 31u, 59u}) {
    REQUIRE(stgs_player_seek_frame(player.get(), frame) == STGS_OK);
    REQUIRE(wait_until_complete(player.get(), 0));
    CHECK(render_current(renderer.get(), player.get(), small_view()) ==
          expected_image(frame / 30.0));
  }
  const int reads = file.reads;
  player.reset();
  CHECK(file.closed == (reads > 0 ? 1 : 0));
}

TEST_CASE("a source may complete its reads later, on any thread", "[sdk]") {
  FaultySource file(clip_file());
  file.stall_from = 0;
  const PlayerPtr player = make_player();
  const stgs_async_io io = file.async_io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  CHECK(update(player.get(), 0).state == STGS_PLAYER_OPENING);
  CHECK(stgs_player_open_async_io(player.get(), &io) == STGS_ERROR_STATE);
  CHECK(stgs_player_seek(player.get(), 1) == STGS_ERROR_STATE);
  std::atomic<bool> done{false};
  std::thread completing([&] {
    while (!done) {
      file.complete();
      std::this_thread::yield();
    }
  });
  CHECK(stgs_player_wait_open(player.get()) == STGS_OK);
  CHECK(wait_until_complete(player.get(), 0));
  done = true;
  completing.join();
  CHECK(render_current(cpu_renderer().get(), player.get(), small_view()) == expected_image(0));
}

TEST_CASE("a player starts while its application completes reads between updates", "[sdk]") {
  FaultySource file(clip_file());
  file.stall_from = 0;
  const PlayerPtr player = make_player();
  const stgs_async_io io = file.async_io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status& status) {
    file.complete();
    return status.state == STGS_PLAYER_PLAYING;
  }));
  const auto events = take_events(player.get());
  CHECK(count_events(events, STGS_EVENT_OPENED) == 1);
  CHECK(count_events(events, STGS_EVENT_RESUMED) == 1);
}

TEST_CASE("playback ends, reverses and loops, and reports events", "[sdk]") {
  const PlayerPtr player = make_player();
  CHECK(update(player.get(), 0).state == STGS_PLAYER_CLOSED);
  CHECK(stgs_player_set_rate(player.get(), 0) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_set_rate(player.get(), 4.5) == STGS_ERROR_ARGUMENT);
  // Applied once the file is open.
  REQUIRE(stgs_player_set_rate(player.get(), 2) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  double now = 0, last = 0;
  const auto play_until = [&](auto holds) {
    return wait_until([&] {
      const stgs_player_status status = update(player.get(), now);
      if (status.state == STGS_PLAYER_PLAYING) now += 1.0 / 60;
      return holds(status);
    });
  };
  REQUIRE(play_until([&](const stgs_player_status& status) {
    CHECK(status.seconds >= last);
    CHECK(status.seconds - last <= 2.01 / 60);
    last = status.seconds;
    return status.state == STGS_PLAYER_ENDED;
  }));
  CHECK(last == Approx((kClipFrames - 1) / 30.0));
  CHECK(count_events(take_events(player.get()), STGS_EVENT_ENDED) == 1);

  REQUIRE(stgs_player_set_rate(player.get(), -2) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(play_until([&](const stgs_player_status& s) { return s.state == STGS_PLAYER_ENDED; }));
  CHECK(update(player.get(), now).seconds == 0);

  REQUIRE(stgs_player_set_loop(player.get(), 1) == STGS_OK);
  REQUIRE(stgs_player_set_rate(player.get(), 4) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  (void)take_events(player.get());
  int loops = 0;
  REQUIRE(play_until([&](const stgs_player_status&) {
    loops += count_events(take_events(player.get()), STGS_EVENT_LOOPED);
    return loops >= 2;
  }));
  REQUIRE(stgs_player_pause(player.get()) == STGS_OK);
  const double paused_at = update(player.get(), now).seconds;
  CHECK(update(player.get(), now + 1).seconds == paused_at);
  CHECK(update(player.get(), now + 2).state == STGS_PLAYER_PAUSED);
}

TEST_CASE("a player reports its buffered ranges and statistics", "[sdk]") {
  const PlayerPtr player = make_player();
  std::uint32_t ranges = 9;
  CHECK(stgs_player_get_buffered(player.get(), nullptr, 0, &ranges) == STGS_OK);
  CHECK(ranges == 0);
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_time_range range{};
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status&) {
    REQUIRE(stgs_player_get_buffered(player.get(), &range, 1, &ranges) == STGS_OK);
    return ranges == 1 && range.begin == 0 && range.end == kClipFrames / 30.0;
  }));
  REQUIRE(wait_until_complete(player.get(), 0));
  const stgs_player_status status = update(player.get(), 0);
  CHECK(status.ready == 1);
  CHECK(status.layers == status.layer_count);
  stgs_player_statistics statistics{};
  statistics.struct_size = sizeof statistics;
  REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
  CHECK(statistics.fetched_bytes > clip_file().size() / 4);
  CHECK(statistics.stored_primitives > 0);
  CHECK(statistics.memory_bytes > statistics.stored_primitives * 60);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  REQUIRE(stgs_scene_get_info(stgs_player_scene(player.get()), &info) == STGS_OK);
  CHECK(info.frames == kClipFrames);
  stgs_scene_destroy(stgs_player_scene(player.get()));  // no effect: the player owns its scene
  CHECK(stgs_scene_get_info(stgs_player_scene(player.get()), &info) == STGS_OK);
  CHECK(stgs_scene_open(stgs_player_scene(player.get()), "x") == STGS_ERROR_STATE);
}

TEST_CASE("the status includes a seek and a pause before the next update", "[sdk]") {
  const PlayerPtr player = make_player();
  stgs_player_status status{};
  CHECK(stgs_player_get_status(player.get(), &status) == STGS_ERROR_STRUCT_SIZE);
  status.struct_size = sizeof status;
  REQUIRE(stgs_player_get_status(player.get(), &status) == STGS_OK);
  CHECK(status.state == STGS_PLAYER_CLOSED);
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  REQUIRE(stgs_player_get_status(player.get(), &status) == STGS_OK);
  CHECK(status.state == STGS_PLAYER_OPENING);  // only an update ends opening
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(update_until(player.get(), 0,
                       [](const stgs_player_status& s) { return s.state == STGS_PLAYER_PLAYING; }));
  REQUIRE(stgs_player_pause(player.get()) == STGS_OK);
  REQUIRE(stgs_player_seek_frame(player.get(), 31) == STGS_OK);
  REQUIRE(stgs_player_get_status(player.get(), &status) == STGS_OK);
  CHECK(status.state == STGS_PLAYER_PAUSED);
  CHECK(status.seconds == Approx(31 / 30.0));
  const stgs_player_status updated = update(player.get(), 1);
  CHECK(updated.seconds == status.seconds);
  CHECK(updated.layer_count == status.layer_count);
}

TEST_CASE("play has no effect on a player that is playing", "[sdk]") {
  const PlayerPtr player = open_player(clip_file());
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  const auto is_playing = [](const stgs_player_status& s) {
    return s.state == STGS_PLAYER_PLAYING;
  };
  REQUIRE(update_until(player.get(), 0, is_playing));
  REQUIRE(wait_until_complete(player.get(), 0));
  (void)take_events(player.get());
  for (int i = 1; i <= 10; ++i) {
    REQUIRE(stgs_player_play(player.get()) == STGS_OK);
    CHECK(update(player.get(), 0.01 * i).state == STGS_PLAYER_PLAYING);
  }
  for (const OwnedEvent& event : take_events(player.get())) {
    CHECK(event.event.kind == STGS_EVENT_LAYERS);
  }
}

TEST_CASE("a player is updated and rendered on two threads while another player plays", "[sdk]") {
  const PlayerPtr player = open_player(clip_file());
  REQUIRE(stgs_player_set_loop(player.get(), 1) == STGS_OK);
  REQUIRE(stgs_player_set_rate(player.get(), 4) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  std::atomic<double> time{0};
  std::atomic<int> failed{0};
  std::atomic<bool> done{false};
  const stgs_view view = small_view();
  std::thread rendering([&] {
    const RendererPtr renderer = cpu_renderer();
    std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
    stgs_image image{};
    image.struct_size = sizeof image;
    image.rgba8 = {pixels.data(), 0, pixels.size()};
    while (!done) {
      if (stgs_render(renderer.get(), stgs_player_scene(player.get()), time, &view, &image, 1) !=
          STGS_OK) {
        ++failed;
      }
    }
  });
  std::thread second([&] {
    stgs_player* other = nullptr;
    stgs_player_status status{};
    status.struct_size = sizeof status;
    if (stgs_player_create(nullptr, &other) != STGS_OK ||
        stgs_player_open_memory(other, clip_file().data(), clip_file().size()) != STGS_OK ||
        stgs_player_wait_open(other) != STGS_OK || stgs_player_play(other) != STGS_OK) {
      ++failed;
    }
    for (double now = 0; now < 5; now += 0.01) {
      if (stgs_player_update(other, now, &status) != STGS_OK) ++failed;
      if (status.state == STGS_PLAYER_ENDED) break;
    }
    stgs_player_destroy(other);
  });
  for (int k = 0; k < 300; ++k) {
    if (k % 50 == 49) REQUIRE(stgs_player_seek(player.get(), 0.01 * (k % 170)) == STGS_OK);
    time = update(player.get(), 0.01 * k).seconds;
    std::this_thread::yield();
  }
  done = true;
  rendering.join();
  second.join();
  CHECK(failed == 0);
}

}  // namespace stgs::testing
