// SPDX-License-Identifier: Apache-2.0
// Long runs of the C API: objects created and destroyed many times, and an hour of playback from a
// faulty source.
#include <unistd.h>

#include <fstream>
#include <random>

#include "../fuzz/heap.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kFrame = 1.0 / 30;  // seconds
constexpr std::uint32_t kFrames = 300;

// Exceeds the memory budget of the player below.
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

// Completes pending reads at random: a tenth fails, and a fifth stays pending.
class RandomFaults {
 public:
  explicit RandomFaults(DeferredSource& file) : file_(file) {}
  void complete() {
    file_.complete_each([this]() -> std::optional<int> {
      const auto dice = static_cast<int>(random_() % 10);
      if (dice < 2) return {};
      failed += dice == 2 ? 1 : 0;
      return dice == 2 ? 5 : 0;
    });
  }
  int failed = 0;

 private:
  DeferredSource& file_;
  std::minstd_rand random_{7};
};

}  // namespace

TEST_CASE("creating and destroying ten thousand scenes and players leaks no memory", "[sdk]") {
  const auto file = sdk_file();
  const RendererPtr renderer = cpu_renderer();
  const stgs_view view = start_view(open_scene(file).get());
  stgs_player_settings settings = player_settings();
  settings.max_reads_in_flight = 1;
  std::uint64_t heap = 0, resident = 0;
  for (int k = 0; k < 10000; ++k) {
    if (k == 1000) {  // after allocations that happen once per process
      heap = fuzz::heap_used();
      resident = resident_bytes();
    }
    const ScenePtr scene = open_scene(file);
    const PlayerPtr player = make_player(&settings);
    REQUIRE(stgs_player_open_memory(player.get(), file.data(), file.size()) == STGS_OK);
    if (k % 2 == 0) continue;  // destroys the player while it opens
    REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    REQUIRE(stgs_player_play(player.get()) == STGS_OK);
    (void)update(player.get(), 0);
    if (k % 100 == 1) {
      (void)render_rgba8(renderer.get(), scene.get(), 0.5, view);
      (void)render_current(renderer.get(), player.get(), view);
    }
  }
  CHECK(fuzz::heap_used() < heap + (1 << 16));
  // Also covers memory that operator new does not count. The C library caches up to 40 MB of stacks
  // of finished threads.
  CHECK(resident_bytes() < resident + (64 << 20));
}

TEST_CASE("a player survives an hour of playback from a source that fails and stalls", "[sdk]") {
  constexpr int kTicks = 3600 * 30;
  const auto clip = long_clip();
  DeferredSource file(clip);
  RandomFaults faults(file);
  stgs_player_settings settings = player_settings();
  settings.retry_seconds = 1e-3;
  settings.prefetch_seconds = 0.5;
  settings.memory_budget = 5 << 18;  // one time with all its layers, but not the entire clip
  const PlayerPtr player = make_player(&settings);
  const stgs_async_io io = file.io();
  REQUIRE(stgs_player_open_async_io(player.get(), &io) == STGS_OK);
  REQUIRE(wait_until([&] {
    file.complete(0);
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
  int loops = 0, read_failures = 0, violations = 0;
  std::uint64_t fetched = 0, heap = 0;
  for (int tick = 0; tick < kTicks; ++tick) {
    // The clock advances only while the player plays; a stall is waited out in real time.
    REQUIRE(update_until(player.get(), now, [&](const stgs_player_status& status) {
      // 1000 of every 9000 ticks have no faults.
      tick % 9000 < 8000 ? faults.complete() : file.complete(0);
      return status.state == STGS_PLAYER_PLAYING;
    }));
    now += kFrame;
    const stgs_player_status status = update(player.get(), now);
    stgs_player_statistics statistics{};
    statistics.struct_size = sizeof statistics;
    REQUIRE(stgs_player_get_statistics(player.get(), &statistics) == STGS_OK);
    violations += status.seconds >= 0 && status.seconds <= kFrames * kFrame ? 0 : 1;
    violations += statistics.memory_bytes <= settings.memory_budget ? 0 : 1;
    fetched = statistics.fetched_bytes;
    for (const OwnedEvent& one : take_events(player.get())) {
      loops += one.event.kind == STGS_EVENT_LOOPED ? 1 : 0;
      read_failures += one.event.kind == STGS_EVENT_READ_FAILED ? 1 : 0;
    }
    if (random() % 2000 == 0) {
      REQUIRE(stgs_player_seek(player.get(), 0.01 * static_cast<double>(random() % 1000)) ==
              STGS_OK);
    }
    if (tick % 1000 == 0) {
      (void)render_rgba8(renderer.get(), stgs_player_scene(player.get()), status.seconds, view);
    }
    if (tick == kTicks / 4) heap = fuzz::heap_used();
  }
  CHECK(violations == 0);
  CHECK(loops > 250);
  CHECK(read_failures > 0);
  CHECK(faults.failed > 0);
  CHECK(fetched > 20 * clip.size());
  CHECK(fuzz::heap_used() < heap + (4 << 20));

  // Without further faults, the image is complete again.
  REQUIRE(stgs_player_pause(player.get()) == STGS_OK);
  REQUIRE(stgs_player_seek_frame(player.get(), 31) == STGS_OK);
  REQUIRE(update_until(player.get(), now, [&](const stgs_player_status& status) {
    file.complete(0);
    return status.layers == status.layer_count;
  }));
  CHECK(render_current(renderer.get(), player.get(), view) ==
        render_rgba8(renderer.get(), open_scene(clip).get(), 31 * kFrame, view));
}

TEST_CASE("a source is closed once if any allocation fails while it is opened", "[sdk]") {
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
      FAIL("allocation " << failures + 1 << ": result " << result << ", closed " << closed);
    }
    CHECK((result != STGS_OK || closed == 0));
    scene.reset();
    REQUIRE(closed == 1);
  }
  CHECK(failures > 10);
}

}  // namespace stgs::testing
