// SPDX-License-Identifier: Apache-2.0
// The C interface's player: wherever its file comes from, whenever its reads are answered.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>

#include "copy_fixture.h"
#include "sdk_player_fixture.h"
#include "temporary_folder.h"

namespace stgs::testing {
namespace {

stgs_view small_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, kSdkWidth, kSdkHeight) == STGS_OK);
  return view;
}

std::vector<std::uint8_t> expected_picture(double seconds) {
  const ScenePtr scene = open_scene(clip_file());
  return draw_rgba8(cpu_renderer().get(), scene.get(), seconds, small_view());
}

int count(const std::vector<KeptEvent>& events, stgs_event_kind kind) {
  return static_cast<int>(std::count_if(events.begin(), events.end(),
                                        [&](const KeptEvent& e) { return e.event.kind == kind; }));
}

bool has(const std::string& text, const char* words) {
  return text.find(words) != std::string::npos;
}

}  // namespace

TEST_CASE("a player's picture is the scene's, wherever its file comes from", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "clip.stgs";
  CallerFile file(clip_file());
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
    auto passing = std::make_unique<std::vector<std::uint8_t>>(clip_file());
    opened = stgs_player_open_memory_copy(player.get(), passing->data(), passing->size());
  }
  SECTION("callbacks") {
    const stgs_io io = file.io();
    opened = stgs_player_open_io(player.get(), &io);
  }
  SECTION("callbacks that answer at once") {
    const stgs_async_io io = file.async_io();
    opened = stgs_player_open_async_io(player.get(), &io);
  }
  REQUIRE(opened == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  std::filesystem::remove(path);
  const RendererPtr renderer = cpu_renderer();
  for (const std::uint32_t frame : {0u, 31u, 59u}) {
    REQUIRE(stgs_player_seek_frame(player.get(), frame) == STGS_OK);
    REQUIRE(settle(player.get(), 0));
    CHECK(draw_moment(renderer.get(), player.get(), small_view()) ==
          expected_picture(frame / 30.0));
  }
  const int reads = file.reads;
  player.reset();
  CHECK(file.closed == (reads > 0 ? 1 : 0));
}

TEST_CASE("a source may answer its reads later, from any thread", "[sdk]") {
  CallerFile file(clip_file());
  file.stall_from = 0;
  const PlayerPtr player = make_player();
  const stgs_async_io io = file.async_io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  CHECK(update(player.get(), 0).state == STGS_PLAYER_OPENING);
  CHECK(stgs_player_open_async_io(player.get(), &io) == STGS_ERROR_STATE);
  CHECK(stgs_player_seek(player.get(), 1) == STGS_ERROR_STATE);
  std::atomic<bool> done{false};
  std::thread answering([&] {
    while (!done) {
      file.answer();
      std::this_thread::yield();
    }
  });
  CHECK(stgs_player_wait_open(player.get()) == STGS_OK);
  CHECK(settle(player.get(), 0));
  done = true;
  answering.join();
  CHECK(draw_moment(cpu_renderer().get(), player.get(), small_view()) == expected_picture(0));
}

TEST_CASE("an application that answers between its updates never waits", "[sdk]") {
  CallerFile file(clip_file());
  file.stall_from = 0;
  const PlayerPtr player = make_player();
  const stgs_async_io io = file.async_io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status& status) {
    file.answer();
    return status.state == STGS_PLAYER_PLAYING;
  }));
  const auto events = take_events(player.get());
  CHECK(count(events, STGS_EVENT_OPENED) == 1);
  CHECK(count(events, STGS_EVENT_RESUMED) == 1);
}

TEST_CASE("a player plays to the end, backwards and round, and tells", "[sdk]") {
  const PlayerPtr player = make_player();
  CHECK(update(player.get(), 0).state == STGS_PLAYER_CLOSED);
  CHECK(stgs_player_set_rate(player.get(), 0) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_player_set_rate(player.get(), 4.5) == STGS_ERROR_ARGUMENT);
  // Kept until the file is open.
  REQUIRE(stgs_player_set_rate(player.get(), 2) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(stgs_player_open_memory(player.get(), clip_file().data(), clip_file().size()) == STGS_OK);
  double now = 0, last = 0;
  const auto play_on = [&](auto holds) {
    return wait_until([&] {
      const stgs_player_status status = update(player.get(), now);
      if (status.state == STGS_PLAYER_PLAYING) now += 1.0 / 60;
      return holds(status);
    });
  };
  REQUIRE(play_on([&](const stgs_player_status& status) {
    CHECK(status.seconds >= last);
    CHECK(status.seconds - last <= 2.01 / 60);
    last = status.seconds;
    return status.state == STGS_PLAYER_ENDED;
  }));
  CHECK(last == Approx((kClipFrames - 1) / 30.0));
  CHECK(count(take_events(player.get()), STGS_EVENT_ENDED) == 1);

  REQUIRE(stgs_player_set_rate(player.get(), -2) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  REQUIRE(play_on([&](const stgs_player_status& s) { return s.state == STGS_PLAYER_ENDED; }));
  CHECK(update(player.get(), now).seconds == 0);

  REQUIRE(stgs_player_set_loop(player.get(), 1) == STGS_OK);
  REQUIRE(stgs_player_set_rate(player.get(), 4) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  (void)take_events(player.get());
  int rounds = 0;
  REQUIRE(play_on([&](const stgs_player_status&) {
    rounds += count(take_events(player.get()), STGS_EVENT_LOOPED);
    return rounds >= 2;
  }));
  REQUIRE(stgs_player_pause(player.get()) == STGS_OK);
  const double still = update(player.get(), now).seconds;
  CHECK(update(player.get(), now + 1).seconds == still);
  CHECK(update(player.get(), now + 2).state == STGS_PLAYER_PAUSED);
}

TEST_CASE("a player tells what has come", "[sdk]") {
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
  REQUIRE(settle(player.get(), 0));
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
  stgs_scene_destroy(stgs_player_scene(player.get()));  // leaves it alone
  CHECK(stgs_scene_get_info(stgs_player_scene(player.get()), &info) == STGS_OK);
  CHECK(stgs_scene_open(stgs_player_scene(player.get()), "x") == STGS_ERROR_STATE);
}

TEST_CASE("a file that cannot be opened is told, and another may be tried", "[sdk]") {
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
  CHECK(has(events[0].message, "/nowhere/none.stgs: cannot open"));
  CHECK(has(logged, "/nowhere/none.stgs: cannot open"));
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_IO);
  CHECK(has(error_of(player.get()).message, "/nowhere/none.stgs"));

  auto damaged = without_copy(clip_file());
  damaged[20] ^= 1;
  REQUIRE(stgs_player_open_memory(player.get(), damaged.data(), damaged.size()) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_INVALID_FILE);
  CHECK(error_of(player.get()).issue == 103);
  events = take_events(player.get());
  REQUIRE(events.size() == 1);
  CHECK(events[0].event.offset != STGS_NO_OFFSET);

  CallerFile file(clip_file());
  file.error = 42;
  stgs_async_io io = file.async_io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_IO);
  const std::string message = error_of(player.get()).message;
  CHECK(has(message, "failed with error 42"));
  CHECK(message.rfind("application source:") == 0);  // once
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

TEST_CASE("what an opening that fails has tried is told before that it failed", "[sdk]") {
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
  const bool fetches = stgs_player_wait_open(player.get()) == STGS_ERROR_IO;  // else not built
  const int retry = STGS_EVENT_RETRY, failed = STGS_EVENT_FAILED;
  CHECK(kinds == (fetches ? std::vector{retry, retry, failed} : std::vector{failed}));
}

TEST_CASE("a player's limits hold before anything is fetched", "[sdk]") {
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
  CHECK(has(error_of(player.get()).message, "limit"));
  stgs_player* none = nullptr;
  settings = player_settings();
  settings.max_reads_in_flight = 0;
  CHECK(stgs_player_create(&settings, &none) == STGS_ERROR_ARGUMENT);
  settings = player_settings();
  settings.struct_size -= 4;
  CHECK(stgs_player_create(&settings, &none) == STGS_ERROR_STRUCT_SIZE);
  CHECK(none == nullptr);
}

TEST_CASE("nothing is read of a file that is larger than a player takes", "[sdk]") {
  CallerFile file(clip_file());
  stgs_player_settings settings = player_settings();
  settings.max_file_bytes = clip_file().size() - 1;
  const PlayerPtr player = make_player(&settings);
  SECTION("callbacks") {
    const stgs_io io = file.io();
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
  }
  SECTION("callbacks that answer later") {
    const stgs_async_io io = file.async_io();
    REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  }
  CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_LIMIT);
  CHECK(file.reads == 0);
  CHECK(file.closed == 1);
}

TEST_CASE("memory that is larger than a player takes is not copied", "[sdk]") {
  stgs_player_settings settings = player_settings();
  settings.max_file_bytes = 100;
  // A byte that is there, and a length that nobody could copy.
  for (const std::size_t bytes : {std::size_t{1} << 46, std::numeric_limits<std::size_t>::max()}) {
    const PlayerPtr player = make_player(&settings);
    REQUIRE(stgs_player_open_memory_copy(player.get(), clip_file().data(), bytes) == STGS_OK);
    CHECK(stgs_player_wait_open(player.get()) == STGS_ERROR_LIMIT);
  }
}

TEST_CASE("nothing happens when what plays is told to play", "[sdk]") {
  const PlayerPtr player = open_player(clip_file());
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  const auto plays = [](const stgs_player_status& s) { return s.state == STGS_PLAYER_PLAYING; };
  REQUIRE(update_until(player.get(), 0, plays));
  REQUIRE(settle(player.get(), 0));
  (void)take_events(player.get());
  for (int i = 1; i <= 10; ++i) {
    REQUIRE(stgs_player_play(player.get()) == STGS_OK);
    CHECK(update(player.get(), 0.01 * i).state == STGS_PLAYER_PLAYING);
  }
  for (const KeptEvent& event : take_events(player.get())) {
    CHECK(event.event.kind == STGS_EVENT_LAYERS);
  }
}

TEST_CASE("what was wrong with a file when it was opened is told behind that", "[sdk]") {
  auto bytes = clip_file();
  bytes.resize(bytes.size() * 2 / 3);
  const PlayerPtr player = open_player(bytes);
  const std::vector<KeptEvent> events = take_events(player.get());
  REQUIRE(events.size() >= 2);
  CHECK(events[0].event.kind == STGS_EVENT_OPENED);
  CHECK(events[1].event.kind == STGS_EVENT_DAMAGED);
  CHECK(events[1].event.result == STGS_ERROR_INVALID_FILE);
  CHECK(events[1].event.offset <= bytes.size());
  CHECK_FALSE(events[1].message.empty());
  CHECK(count(events, STGS_EVENT_DAMAGED) <= STGS_MAX_OPENING_DAMAGE);
  const PlayerPtr sound = open_player(clip_file());
  CHECK(count(take_events(sound.get()), STGS_EVENT_DAMAGED) == 0);
}

TEST_CASE("settings that are refused are named in the log", "[sdk]") {
  std::string said;
  const auto keep = [](void* user, stgs_log_level, const char* message) {
    *static_cast<std::string*>(user) = message;
  };
  stgs_player_settings settings;
  REQUIRE(stgs_player_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.log = keep;
  settings.log_user = &said;
  settings.url_max_attempts = 5000;
  stgs_player* player = nullptr;
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(said == "settings: url_max_attempts is 5000 (expected 1 to 1000)");
  settings.url_max_attempts = 5;
  settings.prefetch_seconds = -1;
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(said == "settings: prefetch_seconds is -1 (expected at least 0)");
  settings.prefetch_seconds = 1;
  stgs_task_runner runner{};
  runner.struct_size = sizeof runner;
  settings.task_runner = &runner;
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(said == "settings: task_runner has no `run`");
  settings.task_runner = nullptr;
  settings.retry_seconds = std::numeric_limits<double>::quiet_NaN();
  CHECK(stgs_player_create(&settings, &player) == STGS_ERROR_ARGUMENT);
  CHECK(said == "settings: retry_seconds is nan (expected at least 0)");
  CHECK(player == nullptr);
}

TEST_CASE("what is damaged or cannot be read while it plays is told with its byte", "[sdk]") {
  auto reader = SceneReader::open(memory_source(clip_file()));
  REQUIRE(reader.ok());
  const SegmentInfo& base = (*reader)->segments().front();
  auto bytes = clip_file();
  bytes[base.offset + base.bytes / 2] ^= 1;
  const PlayerPtr damaged = open_player(bytes);
  REQUIRE(settle(damaged.get(), 0));
  bool told = false;
  for (const KeptEvent& one : take_events(damaged.get())) {
    if (one.event.kind != STGS_EVENT_DAMAGED) continue;
    told = one.event.offset == base.offset && one.event.result == STGS_ERROR_INVALID_FILE &&
           !one.message.empty();
  }
  CHECK(told);

  CallerFile file(clip_file());
  file.error = 7;
  file.error_from = head_bytes_of(clip_file());
  const stgs_io io = file.io();
  const PlayerPtr player = make_player();
  REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  std::vector<KeptEvent> lost;
  REQUIRE(update_until(player.get(), 0, [&](const stgs_player_status&) {
    for (KeptEvent& one : take_events(player.get())) {
      if (one.event.kind == STGS_EVENT_READ_FAILED) lost.push_back(std::move(one));
    }
    return !lost.empty();
  }));
  CHECK(lost[0].event.result == STGS_ERROR_IO);
  CHECK(lost[0].event.offset >= file.error_from);
  CHECK(has(lost[0].message, "failed with error 7"));
}

TEST_CASE("a player ends at any moment while its source stalls", "[sdk]") {
  CallerFile whole(clip_file());
  {
    const PlayerPtr player = make_player();
    const stgs_io io = whole.io();
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
    REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    REQUIRE(settle(player.get(), 0));
  }
  REQUIRE(whole.reads > 3);
  for (const bool async : {false, true}) {
    for (int from = 0; from < whole.reads; ++from) {
      CallerFile file(clip_file());
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
      const bool owing = async && file.waiting() > 0;
      CHECK(file.closed == (owing ? 0 : 1));
      file.answer(from % 2);  // of a player that is gone
      CHECK(file.closed == 1);
    }
  }
}

TEST_CASE("one thread updates a player while another draws it, beside a second player", "[sdk]") {
  const PlayerPtr player = open_player(clip_file());
  REQUIRE(stgs_player_set_loop(player.get(), 1) == STGS_OK);
  REQUIRE(stgs_player_set_rate(player.get(), 4) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  std::atomic<double> moment{0};
  std::atomic<int> failed{0};
  std::atomic<bool> done{false};
  const stgs_view view = small_view();
  std::thread drawing([&] {
    const RendererPtr renderer = cpu_renderer();
    std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
    stgs_image picture{};
    picture.struct_size = sizeof picture;
    picture.rgba8 = {pixels.data(), 0, pixels.size()};
    while (!done) {
      if (stgs_render(renderer.get(), stgs_player_scene(player.get()), moment, &view, &picture,
                      1) != STGS_OK) {
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
    moment = update(player.get(), 0.01 * k).seconds;
    std::this_thread::yield();
  }
  done = true;
  drawing.join();
  second.join();
  CHECK(failed == 0);
}

}  // namespace stgs::testing
