// SPDX-License-Identifier: Apache-2.0
// The player of the C API follows a growing recording.
#include <atomic>
#include <fstream>
#include <thread>

#include "fixtures/fragment_fixture.h"
#include "fixtures/temporary_folder.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kFrame = 1.0 / 30, kFragmentSeconds = kFragmentFrames * kFrame;
constexpr std::uint32_t kFragments = 9;

struct Recording {
  std::vector<std::uint8_t> bytes;
  std::vector<std::size_t> ends;  // [i]: the file size after i fragments
};

const Recording& recording() {
  static const Recording shared = [] {
    const TemporaryFolder folder;
    const std::string path = folder / "live.stgs";
    auto recorder = SceneRecorder::create(path, recording_metadata(), 1,
                                          recording_settings(Profile::kQuantised));
    REQUIRE(recorder.ok());
    Recording out;
    out.ends.push_back((*recorder)->bytes());
    for (std::uint32_t i = 0; i < kFragments; ++i) {
      REQUIRE((*recorder)->append(make_fragment(i), (i + 1) * kFragmentFrames).ok());
      out.ends.push_back((*recorder)->bytes());
    }
    REQUIRE((*recorder)->close().ok());
    std::ifstream file(path, std::ios::binary);
    out.bytes.assign(std::istreambuf_iterator<char>(file), {});
    return out;
  }();
  return shared;
}

// A growing prefix of the recording, as a file and through callbacks.
class GrowingFile {
 public:
  explicit GrowingFile(std::size_t size) { grow(size); }

  void grow(std::size_t size) {
    std::ofstream(path_, std::ios::binary | std::ios::app)
        .write(reinterpret_cast<const char*>(recording().bytes.data() + size_),
               static_cast<std::streamsize>(size - size_));
    size_ = size;
  }
  void damage(std::size_t offset) {
    std::fstream file(path_, std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(static_cast<std::streamoff>(offset));
    file.put(static_cast<char>(recording().bytes[offset] ^ 1));
  }
  const std::string& path() const { return path_; }
  stgs_io io() {
    stgs_io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.read = [](void*, std::uint64_t offset, void* out, std::size_t bytes) {
      std::memcpy(out, recording().bytes.data() + offset, bytes);
      return 0;
    };
    io.current_size = size_of;
    return io;
  }
  stgs_async_io async_io() {
    stgs_async_io io{};
    io.struct_size = sizeof io;
    io.user = this;
    io.begin = [](void*, stgs_read* read, std::uint64_t offset, void* out, std::size_t bytes) {
      std::memcpy(out, recording().bytes.data() + offset, bytes);
      stgs_read_complete(read, 0);
    };
    io.current_size = size_of;
    return io;
  }

 private:
  static std::uint64_t size_of(void* user) { return static_cast<GrowingFile*>(user)->size_; }

  const TemporaryFolder folder_;
  const std::string path_ = folder_ / "live.stgs";
  std::atomic<std::size_t> size_ = 0;
};

stgs_player_live live_of(stgs_player* player) {
  stgs_player_live live{};
  live.struct_size = sizeof live;
  REQUIRE(stgs_player_get_live(player, &live) == STGS_OK);
  return live;
}

}  // namespace

TEST_CASE("a player follows a recording from every kind of source", "[sdk]") {
  GrowingFile file(recording().ends[5]);
  stgs_player_settings settings = player_settings();
  settings.live_latency_seconds = 0.5;
  settings.live_poll_seconds = 0.002;
  settings.live_stall_seconds = 0.1;
  const PlayerPtr owned = make_player(&settings);
  stgs_player* const player = owned.get();
  CHECK(stgs_player_go_live(player) == STGS_ERROR_STATE);
  CHECK(live_of(player).growing == 0);
  SECTION("a path") {
    REQUIRE(stgs_player_open(player, file.path().c_str()) == STGS_OK);
  }
  SECTION("callbacks") {
    const stgs_io io = file.io();
    REQUIRE(stgs_player_open_io(player, &io) == STGS_OK);
  }
  SECTION("asynchronous callbacks") {
    const stgs_async_io io = file.async_io();
    REQUIRE(stgs_player_open_async_io(player, &io) == STGS_OK);
  }
  REQUIRE(stgs_player_play(player) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player) == STGS_OK);
  const auto is_playing = [](const stgs_player_status& s) {
    return s.state == STGS_PLAYER_PLAYING;
  };
  REQUIRE(update_until(player, 10, is_playing));
  stgs_player_live live = live_of(player);
  CHECK(live.growing == 1);
  CHECK(live.following == 1);
  CHECK(live.edge_seconds == Approx(5 * kFragmentSeconds));
  CHECK(live.latency_seconds == Approx(0.5).margin(kFrame));
  CHECK(live.target_latency_seconds == Approx(0.5));
  file.grow(recording().ends[8]);
  REQUIRE(update_until(player, 10, [&](const stgs_player_status&) {
    return live_of(player).edge_seconds > 7.9 * kFragmentSeconds;
  }));
  REQUIRE(stgs_player_pause(player) == STGS_OK);
  CHECK(live_of(player).following == 0);
  REQUIRE(stgs_player_seek(player, 0.1) == STGS_OK);
  REQUIRE(wait_until_complete(player, 10));
  REQUIRE(stgs_player_go_live(player) == STGS_OK);
  update(player, 10);
  CHECK(live_of(player).following == 1);
  CHECK(live_of(player).latency_seconds == Approx(0.5).margin(kFrame));
  std::vector<OwnedEvent> events;
  const auto has_reported = [&](stgs_event_kind kind) {
    return wait_until([&] {
      update(player, 10);
      for (OwnedEvent& event : take_events(player)) events.push_back(std::move(event));
      return std::any_of(events.begin(), events.end(),
                         [&](const OwnedEvent& event) { return event.event.kind == kind; });
    });
  };
  REQUIRE(has_reported(STGS_EVENT_STALLED));
  file.grow(recording().bytes.size());
  REQUIRE(has_reported(STGS_EVENT_FINISHED));
  CHECK(live_of(player).growing == 0);
  CHECK(live_of(player).edge_seconds == 0);
  CHECK(stgs_player_go_live(player) == STGS_OK);
}

TEST_CASE("only threads of the player query the current size of a source", "[sdk]") {
  static std::atomic<int> calls_on_test_thread, calls_elsewhere;
  static std::thread::id test_thread;
  calls_on_test_thread = calls_elsewhere = 0;
  test_thread = std::this_thread::get_id();
  const auto size_of = [](void*) -> std::uint64_t {
    ++(std::this_thread::get_id() == test_thread ? calls_on_test_thread : calls_elsewhere);
    return recording().bytes.size();
  };
  GrowingFile file(0);
  stgs_io io = file.io();
  io.current_size = size_of;
  SECTION("callbacks") {
    const PlayerPtr player = make_player();
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
    CHECK(stgs_player_wait_open(player.get()) == STGS_OK);
    CHECK(calls_elsewhere >= 1);
  }
  SECTION("asynchronous callbacks") {
    stgs_async_io async = file.async_io();
    async.current_size = size_of;
    const PlayerPtr player = make_player();
    REQUIRE(stgs_player_open_async_io(player.get(), &async) == STGS_OK);
    CHECK(stgs_player_wait_open(player.get()) == STGS_OK);
    CHECK(calls_elsewhere >= 1);
  }
  SECTION("a scene does not query it") {
    io.size = recording().bytes.size();
    const ScenePtr scene = make_scene();
    CHECK(stgs_scene_open_io(scene.get(), &io) == STGS_OK);
    CHECK(calls_elsewhere == 0);
  }
  CHECK(calls_on_test_thread == 0);
}

TEST_CASE("without live_follow, a recording plays as a clip of its current length", "[sdk]") {
  const GrowingFile file(recording().ends[5]);
  stgs_player_settings settings = player_settings();
  settings.live_skip_seconds = -1;
  stgs_player* none = nullptr;
  CHECK(stgs_player_create(&settings, &none) == STGS_ERROR_ARGUMENT);
  settings.live_skip_seconds = 3;
  settings.live_follow = 0;
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open(player.get(), file.path().c_str()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  CHECK(live_of(player.get()).growing == 0);
  CHECK(update(player.get(), 0).seconds == 0);
}

TEST_CASE("texts of a scene stay valid while its recording grows", "[sdk]") {
  GrowingFile file(recording().ends[7]);
  file.damage(40);  // in the head, which is read from its copy in the last fragment
  stgs_player_settings settings = player_settings();
  settings.live_poll_seconds = 0.002;
  const PlayerPtr player = make_player(&settings);
  REQUIRE(stgs_player_open(player.get(), file.path().c_str()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_scene* const scene = stgs_player_scene(player.get());
  const auto generator = [&] {
    const char* text = nullptr;
    REQUIRE(stgs_scene_get_text(scene, STGS_TEXT_GENERATOR, &text) == STGS_OK);
    return text;
  };
  const auto issue = [&] {
    stgs_issue first{};
    first.struct_size = sizeof first;
    REQUIRE(stgs_scene_get_issue(scene, 0, &first) == STGS_OK);
    return first.message;
  };
  const auto frames = [&] {
    stgs_scene_info info{};
    info.struct_size = sizeof info;
    REQUIRE(stgs_scene_get_info(scene, &info) == STGS_OK);
    return info.frames;
  };
  const char *const first_generator = generator(), *const first_issue = issue();
  const std::string generator_copy = first_generator, issue_copy = first_issue;
  const std::uint32_t initial_frames = frames();
  const RendererPtr renderer = cpu_renderer();
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, 32, 18) == STGS_OK);
  for (const std::size_t fragments : {8, 9}) {
    const std::uint32_t before = frames();
    file.grow(recording().ends[fragments]);
    REQUIRE(wait_until([&] {
      (void)update(player.get(), 10);
      (void)render_rgba8(renderer.get(), scene, 0, view);
      return frames() > before;
    }));
  }
  CHECK(frames() > initial_frames);
  CHECK(generator() == first_generator);  // the same pointer, not only the same text
  CHECK(first_generator == generator_copy);
  CHECK(first_issue == issue_copy);
}

}  // namespace stgs::testing
