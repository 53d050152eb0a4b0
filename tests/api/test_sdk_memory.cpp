// SPDX-License-Identifier: Apache-2.0
// No memory at any one moment, for one request or some in a row: every call says so or succeeds,
// and afterwards all works.
#include <filesystem>
#include <fstream>

#include "../fuzz/heap.h"
#include "sdk_player_fixture.h"
#include "stretch_fixture.h"
#include "temporary_folder.h"

namespace stgs::testing {
namespace {

constexpr double kMoment = 0.5;  // seconds

bool is_told(stgs_result result) {
  return result == STGS_OK || result == STGS_ERROR_OUT_OF_MEMORY;
}

stgs_view small_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, kSdkWidth, kSdkHeight) == STGS_OK);
  return view;
}

// Of a clip: TBB, which waits for ever where it has no memory for its beginning, has begun after.
std::vector<std::uint8_t> picture_of(const std::vector<std::uint8_t>& file) {
  return draw_rgba8(cpu_renderer().get(), open_scene(file).get(), kMoment, small_view());
}

// Memory fails while `call` runs, which uses no assertions: these take memory.
template <typename Call>
bool has_failed_within(int first, int count, const Call& call) {
  fuzz::fail_requests(first, first + count - 1);
  call();
  const bool failed = fuzz::have_failed();
  fuzz::fail_requests(0, 0);
  return failed;
}

// Uses a player as an application does.
struct Use {
  stgs_player* player;
  stgs_renderer* renderer;
  const stgs_view view;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(4 * kSdkWidth * kSdkHeight);
  stgs_image picture = empty_picture();
  bool told = true;  // every call has ended as it may
  bool settled = false;
  bool opened = false, finished = false;  // what events said

  void step(double now) {
    stgs_player_status status{};
    status.struct_size = sizeof status;
    told &= is_told(stgs_player_update(player, now, &status));
    settled = status.is_complete != 0 && status.layers == status.layer_count;
    stgs_player_event event{};
    event.struct_size = sizeof event;
    while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE) {
      opened |= event.kind == STGS_EVENT_OPENED;
      finished |= event.kind == STGS_EVENT_FINISHED;
    }
    picture.rgba8 = {pixels.data(), 0, pixels.size()};
    told &= is_told(
        stgs_render(renderer, stgs_player_scene(player), status.seconds, &view, &picture, 1));
  }
};

// What was lost for want of memory is asked for again, and not waited for by `is_complete`.
bool settle_whole(stgs_player* player) {
  return update_until(player, 0, [](const stgs_player_status& s) {
    return s.is_complete != 0 && s.layers == s.layer_count;
  });
}

stgs_player_settings quick() {
  stgs_player_settings settings = player_settings();
  settings.retry_seconds = 0.001;
  settings.live_latency_seconds = 0;
  return settings;
}

}  // namespace

TEST_CASE("a scene is opened and drawn with memory that ends at any moment", "[sdk]") {
  const auto file = sdk_file();
  const auto expected = picture_of(file);
  const stgs_view view = small_view();
  bool failed = true;
  for (int n = 1; failed; ++n) {
    const ScenePtr scene = make_scene();
    const RendererPtr renderer = cpu_renderer();
    std::vector<std::uint8_t> pixels(expected.size());
    stgs_image picture = empty_picture();
    picture.rgba8 = {pixels.data(), 0, pixels.size()};
    stgs_result opened = STGS_OK, drawn = STGS_OK;
    failed = has_failed_within(n, 1, [&] {
      opened = stgs_scene_open_memory(scene.get(), file.data(), file.size());
      if (opened == STGS_OK) {
        drawn = stgs_render(renderer.get(), scene.get(), kMoment, &view, &picture, 1);
      }
    });
    INFO("request " << n << ": " << opened << ", " << drawn);
    REQUIRE(is_told(opened));
    REQUIRE(is_told(drawn));
    if (opened != STGS_OK) {
      REQUIRE(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_OK);
    }
    REQUIRE(draw_rgba8(renderer.get(), scene.get(), kMoment, view) == expected);
  }
}

TEST_CASE("a player is opened and played with memory that ends at any moment", "[sdk]") {
  const auto file = sdk_file();
  const auto expected = picture_of(file);
  const stgs_player_settings settings = quick();
  const int count = GENERATE(1, 30);
  int n = 1;
  for (bool failed = true; failed && n < 1000; n += count == 1 && n < 40 ? 1 : 7) {
    const PlayerPtr player = make_player(&settings);
    const RendererPtr renderer = cpu_renderer();
    Use use{player.get(), renderer.get(), small_view()};
    stgs_result begun = STGS_OK, opened = STGS_OK;
    failed = has_failed_within(n, count, [&] {
      begun = stgs_player_open_memory(player.get(), file.data(), file.size());
      if (begun != STGS_OK) return;
      opened = stgs_player_wait_open(player.get());
      if (opened != STGS_OK) return;
      for (int i = 0; i < 200 && !use.settled; ++i) {
        use.step(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
    INFO("requests " << n << " to " << n + count - 1 << ": " << begun << ", " << opened);
    REQUIRE(is_told(begun));
    REQUIRE(is_told(opened));
    REQUIRE(use.told);
    if (begun != STGS_OK || opened != STGS_OK) {
      const stgs_result again = stgs_player_open_memory(player.get(), file.data(), file.size());
      REQUIRE((again == STGS_OK || again == STGS_ERROR_STATE));
      REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    }
    REQUIRE(wait_until([&] {
      use.step(0);
      return use.settled;
    }));
    REQUIRE(use.opened);
    REQUIRE(stgs_player_seek(player.get(), kMoment) == STGS_OK);
    REQUIRE(settle_whole(player.get()));
    REQUIRE(draw_moment(renderer.get(), player.get(), small_view()) == expected);
  }
  CHECK(n > 50);
}

TEST_CASE("a recording is followed with memory that ends at any moment", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  std::vector<std::size_t> ends;
  {
    auto recorder = SceneRecorder::create(path, recording_metadata(), 1,
                                          recording_settings(Profile::kQuantised));
    REQUIRE(recorder.ok());
    for (std::uint32_t i = 0; i < 4; ++i) {
      REQUIRE((*recorder)->append(stretch(i), (i + 1) * kStretchFrames).ok());
      ends.push_back((*recorder)->bytes());
    }
    REQUIRE((*recorder)->close().ok());
  }
  std::ifstream recorded(path, std::ios::binary);
  const std::vector<std::uint8_t> file(std::istreambuf_iterator<char>(recorded), {});
  const auto expected = picture_of(file);
  struct Growing {
    const std::vector<std::uint8_t>& bytes;
    std::atomic<std::uint64_t> size;
  };
  const stgs_player_settings settings = quick();
  for (int n = 1; n < 300; n += n < 60 ? 2 : 20) {
    Growing growing{file, {ends[1]}};
    stgs_io io{};
    io.struct_size = sizeof io;
    io.user = &growing;
    io.read = [](void* user, std::uint64_t offset, void* out, std::size_t bytes) {
      std::memcpy(out, static_cast<Growing*>(user)->bytes.data() + offset, bytes);
      return 0;
    };
    io.current_size = [](void* user) { return static_cast<Growing*>(user)->size.load(); };
    const PlayerPtr player = make_player(&settings);
    const RendererPtr renderer = cpu_renderer();
    Use use{player.get(), renderer.get(), small_view()};
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
    REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    use.step(0);
    (void)has_failed_within(n, 3, [&] {
      growing.size = ends[2];
      for (int i = 0; i < 15; ++i) {
        use.step(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      growing.size = file.size();
      for (int i = 0; i < 15; ++i) {
        use.step(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
    INFO("requests from " << n << " on");
    REQUIRE(use.told);
    REQUIRE(wait_until([&] {
      use.step(0);
      return use.finished;
    }));
    REQUIRE(stgs_player_seek(player.get(), kMoment) == STGS_OK);
    REQUIRE(settle_whole(player.get()));
    REQUIRE(draw_moment(renderer.get(), player.get(), small_view()) == expected);
  }
}

}  // namespace stgs::testing
