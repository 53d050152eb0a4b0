// SPDX-License-Identifier: Apache-2.0
// Long lives of the C interface: objects made and ended many times, and an hour of play from a
// source that misbehaves.
#include <unistd.h>

#include <fstream>
#include <random>

#include "../fuzz/heap.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kFrame = 1.0 / 30;  // seconds
constexpr std::uint32_t kFrames = 300;

// More than the memory has room for.
std::vector<std::uint8_t> long_clip() {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = 0.5;
  auto bytes = encode_scene(random_scene(12000, 1, kFrames, 3), settings);
  REQUIRE(bytes.ok());
  return std::move(bytes).value();
}

std::uint64_t resident_bytes() {
  std::uint64_t all = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> all >> resident;
  return resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

// Answers what waits as it comes: a tenth fails, and a fifth waits for another time.
class Faults {
 public:
  explicit Faults(LateFile& file) : file_(file) {}
  void answer() {
    file_.answer_each([this]() -> std::optional<int> {
      const auto dice = static_cast<int>(random_() % 10);
      if (dice < 2) return {};
      failed += dice == 2 ? 1 : 0;
      return dice == 2 ? 5 : 0;
    });
  }
  int failed = 0;

 private:
  LateFile& file_;
  std::minstd_rand random_{7};
};

}  // namespace

TEST_CASE("ten thousand scenes and players come and go, and leave nothing", "[sdk]") {
  const auto file = sdk_file();
  const RendererPtr renderer = cpu_renderer();
  const stgs_view view = start_view(open_scene(file).get());
  stgs_player_settings settings = player_settings();
  settings.max_reads_in_flight = 1;
  std::uint64_t heap = 0, resident = 0;
  for (int k = 0; k < 10000; ++k) {
    if (k == 1000) {  // what is made once has been made
      heap = fuzz::heap_used();
      resident = resident_bytes();
    }
    const ScenePtr scene = open_scene(file);
    const PlayerPtr player = make_player(&settings);
    REQUIRE(stgs_player_open_memory(player.get(), file.data(), file.size()) == STGS_OK);
    if (k % 2 == 0) continue;  // it ends while it opens
    REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    REQUIRE(stgs_player_play(player.get()) == STGS_OK);
    (void)update(player.get(), 0);
    if (k % 100 == 1) {
      (void)draw_rgba8(renderer.get(), scene.get(), 0.5, view);
      (void)draw_moment(renderer.get(), player.get(), view);
    }
  }
  CHECK(fuzz::heap_used() < heap + (1 << 16));
  // What operator new does not see. The C library keeps up to 40 MB of stacks of threads that
  // ended.
  CHECK(resident_bytes() < resident + (64 << 20));
}

TEST_CASE("an hour of play from a source that fails and stalls", "[sdk]") {
  constexpr int kTicks = 3600 * 30;
  const auto clip = long_clip();
  LateFile file(clip);
  Faults faults(file);
  stgs_player_settings settings = player_settings();
  settings.retry_seconds = 1e-3;
  settings.prefetch_seconds = 0.5;
  settings.memory_budget = 5 << 18;  // a moment with all its layers, but not the whole clip
  const PlayerPtr player = make_player(&settings);
  const stgs_async_io io = file.io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  REQUIRE(wait_until([&] {
    file.answer(0);
    return update(player.get(), 0).state != STGS_PLAYER_OPENING;
  }));
  REQUIRE(stgs_player_set_loop(player.get(), 1) == STGS_OK);
  REQUIRE(stgs_player_play(player.get()) == STGS_OK);
  const RendererPtr renderer = cpu_renderer();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, 32, 24) == STGS_OK);

  std::minstd_rand random(3);
  double now = 0;
  int rounds = 0, lost = 0, broken = 0;
  std::uint64_t fetched = 0, heap = 0;
  for (int tick = 0; tick < kTicks; ++tick) {
    // Time passes while it plays; where it stands still, real time has to.
    REQUIRE(update_until(player.get(), now, [&](const stgs_player_status& status) {
      // Now and then all goes well.
      tick % 9000 < 8000 ? faults.answer() : file.answer(0);
      return status.state == STGS_PLAYER_PLAYING;
    }));
    now += kFrame;
    const stgs_player_status status = update(player.get(), now);
    stgs_player_statistics statistics{};
    statistics.struct_size = sizeof statistics;
    REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
    broken += status.seconds >= 0 && status.seconds <= kFrames * kFrame ? 0 : 1;
    broken += statistics.memory_bytes <= settings.memory_budget ? 0 : 1;
    fetched = statistics.fetched_bytes;
    for (const KeptEvent& one : take_events(player.get())) {
      rounds += one.event.kind == STGS_EVENT_LOOPED ? 1 : 0;
      lost += one.event.kind == STGS_EVENT_READ_FAILED ? 1 : 0;
    }
    if (random() % 2000 == 0) {
      REQUIRE(stgs_player_seek(player.get(), 0.01 * static_cast<double>(random() % 1000)) ==
              STGS_OK);
    }
    if (tick % 1000 == 0) {
      (void)draw_rgba8(renderer.get(), stgs_player_scene(player.get()), status.seconds, view);
    }
    if (tick == kTicks / 4) heap = fuzz::heap_used();
  }
  CHECK(broken == 0);
  CHECK(rounds > 250);
  CHECK(lost > 0);
  CHECK(faults.failed > 0);
  CHECK(fetched > 20 * clip.size());
  CHECK(fuzz::heap_used() < heap + (4 << 20));

  // When the source is well again, so is the picture.
  REQUIRE(stgs_player_pause(player.get()) == STGS_OK);
  REQUIRE(stgs_player_seek_frame(player.get(), 31) == STGS_OK);
  REQUIRE(update_until(player.get(), now, [&](const stgs_player_status& status) {
    file.answer(0);
    return status.layers == status.layer_count;
  }));
  CHECK(draw_moment(renderer.get(), player.get(), view) ==
        draw_rgba8(renderer.get(), open_scene(clip).get(), 31 * kFrame, view));
}

TEST_CASE("a source is closed once, wherever memory ends while it is opened", "[sdk]") {
  const auto file = sdk_file();
  int closed = 0, failures = 0;
  struct Bytes {
    const std::vector<std::uint8_t>& file;
    int& closed;
  } bytes{file, closed};
  stgs_io io{};
  io.struct_size = sizeof io;
  io.user = &bytes;
  io.size = file.size();
  io.read = [](void* user, std::uint64_t offset, void* out, std::size_t count) {
    std::memcpy(out, static_cast<Bytes*>(user)->file.data() + offset, count);
    return 0;
  };
  io.close = [](void* user) { ++static_cast<Bytes*>(user)->closed; };
  for (stgs_result result = STGS_ERROR_OUT_OF_MEMORY; result != STGS_OK; ++failures) {
    ScenePtr scene = make_scene();
    closed = 0;
    fuzz::fail_request(failures + 1);
    result = stgs_scene_open_io(scene.get(), &io);
    fuzz::fail_request(0);
    if (result != STGS_OK && (result != STGS_ERROR_OUT_OF_MEMORY || closed != 1)) {
      FAIL("request " << failures + 1 << ": result " << result << ", closed " << closed);
    }
    CHECK((result != STGS_OK || closed == 0));
    scene.reset();
    REQUIRE(closed == 1);
  }
  CHECK(failures > 10);
}

}  // namespace stgs::testing
