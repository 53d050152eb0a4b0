// SPDX-License-Identifier: Apache-2.0
// Times inside and outside the clip, through the C API.
#include "fixtures/recording_fixture.h"
#include "sdk_player_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kFrameSeconds = 1.0 / 30;
constexpr double kSeconds = 1;  // duration of sdk_file()

// Returns the result of the functions that take a time, which must agree.
stgs_result result_at(stgs_renderer* renderer, stgs_scene* scene, double seconds) {
  stgs_view view = start_view(scene);
  std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height, 7);
  stgs_image image = empty_image();
  image.rgba8 = {pixels.data(), 0, pixels.size()};
  const stgs_result result = stgs_render(renderer, scene, seconds, &view, &image, 1);
  if (result != STGS_OK) {
    CHECK(std::all_of(pixels.begin(), pixels.end(), [](std::uint8_t p) { return p == 7; }));
    const std::string message = error_of(renderer).message;
    CHECK(message.find("outside of the clip") != std::string::npos);
  }
  std::uint64_t count = 0;
  CHECK(stgs_scene_get_primitives(scene, seconds, nullptr, &count) == result);
  return result;
}

}  // namespace

TEST_CASE("a time outside the clip is an error instead of an empty image", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  for (const double seconds : {-1.0, -kFrameSeconds, kSeconds + kFrameSeconds, 99.0, 1e300}) {
    INFO(seconds << " s");
    CHECK(result_at(renderer.get(), scene.get(), seconds) == STGS_ERROR_ARGUMENT);
  }
  for (const double seconds : {0.0, 0.3, kSeconds - kFrameSeconds, kSeconds}) {
    INFO(seconds << " s");
    CHECK(result_at(renderer.get(), scene.get(), seconds) == STGS_OK);
  }
}

TEST_CASE("a time that is outside the clip only by rounding is clamped", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  const stgs_view view = start_view(scene.get());
  const auto at = [&](double seconds) {
    return render_rgba8(renderer.get(), scene.get(), seconds, view);
  };
  CHECK(at(-1e-9) == at(0));
  CHECK(at(-0.4 * kFrameSeconds) == at(0));
  CHECK(at(kSeconds + 1e-9) == at(kSeconds));
  CHECK(at(kSeconds + 0.4 * kFrameSeconds) == at(kSeconds));
}

TEST_CASE("the scene of a player rejects times outside its clip", "[sdk]") {
  const auto file = sdk_file();
  const PlayerPtr player = open_player(file);
  stgs_scene* const scene = stgs_player_scene(player.get());
  const RendererPtr renderer = cpu_renderer();
  CHECK(result_at(renderer.get(), scene, -1) == STGS_ERROR_ARGUMENT);
  CHECK(result_at(renderer.get(), scene, 99) == STGS_ERROR_ARGUMENT);
  // Every time that the player reports is valid, forwards and backwards.
  REQUIRE(stgs_player_set_loop(player.get(), 1) == STGS_OK);
  for (const double rate : {4.0, -2.0}) {
    REQUIRE(stgs_player_set_rate(player.get(), rate) == STGS_OK);
    REQUIRE(stgs_player_play(player.get()) == STGS_OK);
    for (int i = 0; i < 40; ++i) {
      const double seconds = update(player.get(), 100 + rate + 0.1 * i).seconds;
      CHECK(result_at(renderer.get(), scene, seconds) == STGS_OK);
    }
  }
}

TEST_CASE("only a recording that a player follows accepts times after its end", "[sdk]") {
  const TemporaryFolder folder;
  const std::string path = folder / "live.stgs";
  record(path, 3, false);
  const stgs_view view = small_view();
  const RendererPtr renderer = cpu_renderer();
  std::vector<std::uint8_t> pixels(4 * kSdkWidth * kSdkHeight);
  stgs_image image = empty_image();
  image.rgba8 = {pixels.data(), 0, pixels.size()};

  const ScenePtr scene = make_scene();
  REQUIRE(stgs_scene_open(scene.get(), path.c_str()) == STGS_OK);
  CHECK(stgs_render(renderer.get(), scene.get(), 2, &view, &image, 1) == STGS_ERROR_ARGUMENT);

  const PlayerPtr player = make_player();
  REQUIRE(stgs_player_open(player.get(), path.c_str()) == STGS_OK);
  REQUIRE(stgs_player_wait_open(player.get()) == STGS_OK);
  stgs_scene* const followed = stgs_player_scene(player.get());
  CHECK(stgs_render(renderer.get(), followed, 2, &view, &image, 1) == STGS_OK);
  CHECK(stgs_render(renderer.get(), followed, -1, &view, &image, 1) == STGS_ERROR_ARGUMENT);
}

}  // namespace stgs::testing
