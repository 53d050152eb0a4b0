// SPDX-License-Identifier: Apache-2.0
// Failing allocations in scenes and players, single or several in a row. Every call succeeds or
// returns STGS_ERROR_OUT_OF_MEMORY, and later calls succeed.
#include <filesystem>
#include <fstream>

#include "../fuzz/heap.h"
#include "fixtures/fragment_fixture.h"
#include "fixtures/temporary_folder.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kTime = 0.5;  // seconds

bool is_ok_or_out_of_memory(stgs_result result) {
  return result == STGS_OK || result == STGS_ERROR_OUT_OF_MEMORY;
}

// Renders a clip.
std::vector<std::uint8_t> image_of(const std::vector<std::uint8_t>& file) {
  return render_rgba8(cpu_renderer().get(), open_scene(file).get(), kTime, small_view());
}

// Fails `count` allocations of `call` from number `first` on. `call` must not use assertions,
// because they allocate. Returns whether an allocation failed.
template <typename Call>
bool with_failing_allocations(int first, int count, const Call& call) {
  fuzz::fail_requests(first, first + count - 1);
  call();
  const bool failed = fuzz::have_failed();
  fuzz::fail_requests(0, 0);
  return failed;
}

// Updates and renders a player as an application does.
struct Application {
  stgs_player* player;
  stgs_renderer* renderer;
  const stgs_view view;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(4 * kSdkWidth * kSdkHeight);
  stgs_image image = empty_image();
  bool results_valid = true;  // every call succeeded or returned STGS_ERROR_OUT_OF_MEMORY
  bool is_complete = false;   // with all layers
  bool opened = false, finished = false;  // events reported so

  void step(double now) {
    stgs_player_status status{};
    status.struct_size = sizeof status;
    results_valid &= is_ok_or_out_of_memory(stgs_player_update(player, now, &status));
    is_complete = status.is_complete != 0 && status.layers == status.layer_count;
    stgs_player_event event{};
    event.struct_size = sizeof event;
    while (stgs_player_next_event(player, &event) == STGS_OK && event.kind != STGS_EVENT_NONE) {
      opened |= event.kind == STGS_EVENT_OPENED;
      finished |= event.kind == STGS_EVENT_FINISHED;
    }
    image.rgba8 = {pixels.data(), 0, pixels.size()};
    results_valid &= is_ok_or_out_of_memory(
        stgs_render(renderer, stgs_player_scene(player), status.seconds, &view, &image, 1));
  }
};

// Also waits for reads that are retried after a failed allocation, which `is_complete` ignores.
bool wait_for_all_layers(stgs_player* player) {
  return update_until(player, 0, [](const stgs_player_status& s) {
    return s.is_complete != 0 && s.layers == s.layer_count;
  });
}

stgs_player_settings quick_retry_settings() {
  stgs_player_settings settings = player_settings();
  settings.retry_seconds = 0.001;
  settings.live_latency_seconds = 0;
  return settings;
}

}  // namespace

TEST_CASE("opening and rendering a scene survives any failing allocation", "[sdk]") {
  const auto file = sdk_file();
  const auto expected = image_of(file);
  const stgs_view view = small_view();
  bool failed = true;
  for (int n = 1; failed; ++n) {
    const ScenePtr scene = make_scene();
    const RendererPtr renderer = cpu_renderer();
    std::vector<std::uint8_t> pixels(expected.size());
    stgs_image image = empty_image();
    image.rgba8 = {pixels.data(), 0, pixels.size()};
    stgs_result opened = STGS_OK, rendered = STGS_OK;
    failed = with_failing_allocations(n, 1, [&] {
      opened = stgs_scene_open_memory(scene.get(), file.data(), file.size());
      if (opened == STGS_OK) {
        rendered = stgs_render(renderer.get(), scene.get(), kTime, &view, &image, 1);
      }
    });
    INFO("allocation " << n << ": " << opened << ", " << rendered);
    REQUIRE(is_ok_or_out_of_memory(opened));
    REQUIRE(is_ok_or_out_of_memory(rendered));
    if (opened != STGS_OK) {
      REQUIRE(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_OK);
    }
    REQUIRE(render_rgba8(renderer.get(), scene.get(), kTime, view) == expected);
  }
}

TEST_CASE("opening and playing a clip survives failing allocations", "[sdk]") {
  const auto file = sdk_file();
  const auto expected = image_of(file);
  const stgs_player_settings settings = quick_retry_settings();
  const int count = GENERATE(1, 30);
  int n = 1;
  for (bool failed = true; failed && n < 1000; n += count == 1 && n < 40 ? 1 : 7) {
    const PlayerPtr player = make_player(&settings);
    const RendererPtr renderer = cpu_renderer();
    Application app{player.get(), renderer.get(), small_view()};
    stgs_result begun = STGS_OK, opened = STGS_OK;
    failed = with_failing_allocations(n, count, [&] {
      begun = stgs_player_open_memory(player.get(), file.data(), file.size());
      if (begun != STGS_OK) return;
      opened = stgs_player_wait_open(player.get());
      if (opened != STGS_OK) return;
      for (int i = 0; i < 200 && !app.is_complete; ++i) {
        app.step(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
    INFO("allocations " << n << " to " << n + count - 1 << ": " << begun << ", " << opened);
    REQUIRE(is_ok_or_out_of_memory(begun));
    REQUIRE(is_ok_or_out_of_memory(opened));
    REQUIRE(app.results_valid);
    if (begun != STGS_OK || opened != STGS_OK) {
      const stgs_result again = stgs_player_open_memory(player.get(), file.data(), file.size());
      REQUIRE((again == STGS_OK || again == STGS_ERROR_STATE));
      REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    }
    REQUIRE(wait_until([&] {
      app.step(0);
      return app.is_complete;
    }));
    REQUIRE(app.opened);
    REQUIRE(stgs_player_seek(player.get(), kTime) == STGS_OK);
    REQUIRE(wait_for_all_layers(player.get()));
    REQUIRE(render_current(renderer.get(), player.get(), small_view()) == expected);
  }
  CHECK(n > 50);
}

TEST_CASE("following a recording survives failing allocations", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  std::vector<std::size_t> ends;
  {
    auto recorder = SceneRecorder::create(path, recording_metadata(), 1,
                                          recording_settings(Profile::kQuantised));
    REQUIRE(recorder.ok());
    for (std::uint32_t i = 0; i < 4; ++i) {
      REQUIRE((*recorder)->append(make_fragment(i), (i + 1) * kFragmentFrames).ok());
      ends.push_back((*recorder)->bytes());
    }
    REQUIRE((*recorder)->close().ok());
  }
  std::ifstream recorded(path, std::ios::binary);
  const std::vector<std::uint8_t> file(std::istreambuf_iterator<char>(recorded), {});
  const auto expected = image_of(file);
  struct Growing {
    const std::vector<std::uint8_t>& bytes;
    std::atomic<std::uint64_t> size;
  };
  const stgs_player_settings settings = quick_retry_settings();
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
    Application app{player.get(), renderer.get(), small_view()};
    REQUIRE(stgs_player_open_io(player.get(), &io) == STGS_OK);
    REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
    app.step(0);
    (void)with_failing_allocations(n, 3, [&] {
      growing.size = ends[2];
      for (int i = 0; i < 15; ++i) {
        app.step(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      growing.size = file.size();
      for (int i = 0; i < 15; ++i) {
        app.step(0);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
    INFO("allocations from " << n << " on");
    REQUIRE(app.results_valid);
    REQUIRE(wait_until([&] {
      app.step(0);
      return app.finished;
    }));
    REQUIRE(stgs_player_seek(player.get(), kTime) == STGS_OK);
    REQUIRE(wait_for_all_layers(player.get()));
    REQUIRE(render_current(renderer.get(), player.get(), small_view()) == expected);
  }
}

}  // namespace stgs::testing
