// SPDX-License-Identifier: Apache-2.0
// The C API with invalid arguments and damaged files: every error has a result code and a message.
#include <algorithm>
#include <limits>

#include "fixtures/copy_fixture.h"
#include "sdk_fixture.h"

namespace stgs::testing {

TEST_CASE("calls with a null object or a wrong struct size are rejected", "[sdk]") {
  stgs_scene_destroy(nullptr);
  stgs_renderer_destroy(nullptr);
  CHECK(stgs_scene_create(nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_scene_open(nullptr, "x") == STGS_ERROR_ARGUMENT);
  CHECK(stgs_render(nullptr, nullptr, 0, nullptr, nullptr, 1) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_renderer_get_backend(nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  stgs_scene_settings settings = scene_settings();
  CHECK(stgs_scene_settings_defaults(&settings, sizeof settings - 1) == STGS_ERROR_STRUCT_SIZE);
  stgs_scene* scene = nullptr;
  settings.struct_size = 4;
  CHECK(stgs_scene_create(&settings, &scene) == STGS_ERROR_STRUCT_SIZE);
  settings = scene_settings();
  settings.max_memory = 0;
  CHECK(stgs_scene_create(&settings, &scene) == STGS_ERROR_ARGUMENT);
  settings = scene_settings();
  settings.memory_budget = 0;
  CHECK(stgs_scene_create(&settings, &scene) == STGS_ERROR_ARGUMENT);
  CHECK(scene == nullptr);
  stgs_error error{};
  CHECK(stgs_scene_error(make_scene().get(), &error) == STGS_ERROR_STRUCT_SIZE);
  CHECK(std::string(stgs_result_name(STGS_ERROR_LIMIT)) == "STGS_ERROR_LIMIT");
  CHECK(std::string(stgs_result_name(77)) == "unknown result");
}

TEST_CASE("a scene reports that it is not open, and opens after a failed attempt", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = make_scene();
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  CHECK(stgs_scene_get_info(scene.get(), &info) == STGS_ERROR_STATE);
  CHECK(contains(error_of(scene.get()).message, "no file is open"));
  CHECK(stgs_scene_open(scene.get(), "/nowhere/none.stgs") == STGS_ERROR_IO);
  CHECK(contains(error_of(scene.get()).message, "/nowhere/none.stgs: cannot open"));
  CHECK(stgs_scene_open(scene.get(), nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_OK);
  CHECK(error_of(scene.get()).result == STGS_OK);
  CHECK(stgs_scene_open(scene.get(), "x") == STGS_ERROR_STATE);
  const char* text = nullptr;
  CHECK(stgs_scene_get_text(scene.get(), 99, &text) == STGS_ERROR_ARGUMENT);
  info.struct_size = 8;
  CHECK(stgs_scene_get_info(scene.get(), &info) == STGS_ERROR_STRUCT_SIZE);
  CHECK(contains(error_of(scene.get()).message, "struct_size is 8"));
}

TEST_CASE("invalid render arguments are rejected before anything is written", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  const stgs_view good = start_view(scene.get());
  std::vector<std::uint8_t> pixels(4 * kSdkWidth * kSdkHeight, 7);
  stgs_image image = empty_image();
  image.rgba8 = {pixels.data(), 0, pixels.size()};
  const float nan = std::numeric_limits<float>::quiet_NaN();
  double seconds = 0;
  std::uint32_t count = 1;
  stgs_view view = good;
  const char* message = "";

  SECTION("a time that is not a number") {
    seconds = nan, message = "seconds is nan";
  }
  SECTION("zero views") {
    count = 0, message = "count is 0 (expected 1 to 4 views)";
  }
  SECTION("too many views") {
    count = 5, message = "count is 5 (expected 1 to 4 views)";
  }
  SECTION("zero width") {
    view.width = 0, message = "0x48 pixels";
  }
  SECTION("a height above the limit") {
    view.height = 40000, message = "64x40000 pixels";
  }
  SECTION("zero focal length") {
    view.fx = 0, message = "fx 0";
  }
  SECTION("a principal point that is not a number") {
    view.cx = nan, message = "cx nan";
  }
  SECTION("a reflection instead of a rotation") {
    view.rotation[0] = -1, message = "rotation";
  }
  SECTION("a position that is not a number") {
    view.translation[1] = nan, message = "translation";
  }
  SECTION("a near plane at zero") {
    view.near_plane = 0, message = "near_plane";
  }
  SECTION("a background that is not a number") {
    view.background[2] = nan, message = "background";
  }
  SECTION("an image without buffers") {
    image.rgba8.data = nullptr, message = "the image has no buffer";
  }
  SECTION("a stride shorter than a row") {
    image.rgba8.stride = 4 * kSdkWidth - 1, message = "stride";
  }
  SECTION("a buffer that is one byte too small") {
    image.rgba8.bytes -= 1, message = "too small";
  }
  SECTION("a stride that overflows") {
    image.rgba8.stride = std::numeric_limits<std::size_t>::max() / 2, message = "too small";
  }
  SECTION("one colour plane of three") {
    image.rgb[1] = {pixels.data(), 0, pixels.size()}, message = "all three planes";
  }
  SECTION("a float stride that is not a multiple of 4") {
    image.depth = {pixels.data(), 4 * kSdkWidth + 2, pixels.size()}, message = "a multiple of 4";
  }
  CHECK(stgs_render(renderer.get(), scene.get(), seconds, &view, &image, count) ==
        STGS_ERROR_ARGUMENT);
  INFO(error_of(renderer.get()).message);
  CHECK(contains(error_of(renderer.get()).message, message));
  CHECK(std::count(pixels.begin(), pixels.end(), 7) == static_cast<long>(pixels.size()));
}

TEST_CASE("a damaged head is reported with its offset and read from its copy", "[sdk]") {
  auto copied = sdk_file();
  copied[20] ^= 1;  // in the header, which has a checksum
  const ScenePtr repaired = make_scene();
  REQUIRE(stgs_scene_open_memory(repaired.get(), copied.data(), copied.size()) == STGS_OK);
  stgs_issue issue{};
  issue.struct_size = sizeof issue;
  REQUIRE(stgs_scene_get_issue(repaired.get(), 0, &issue) == STGS_OK);
  CHECK(issue.number == 118);
  CHECK(issue.offset == 28);
  CHECK(stgs_scene_get_issue(repaired.get(), 1, &issue) == STGS_ERROR_ARGUMENT);

  auto file = without_copy(sdk_file());
  file[20] ^= 1;
  const ScenePtr scene = make_scene();
  CHECK(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_ERROR_INVALID_FILE);
  const stgs_error error = error_of(scene.get());
  CHECK(error.issue == 103);
  CHECK(error.offset != STGS_NO_OFFSET);
  CHECK(contains(error.message, "memory: "));
}

TEST_CASE("damage is skipped and logged, or rejected on request", "[sdk]") {
  auto file = without_copy(sdk_file());
  file.resize(file.size() - 100);
  std::string logged;
  stgs_scene_settings settings = scene_settings();
  settings.log_user = &logged;
  settings.log = [](void* user, stgs_log_level level, const char* message) {
    if (level == STGS_LOG_WARNING) *static_cast<std::string*>(user) += message;
  };
  const ScenePtr scene = make_scene(&settings);
  REQUIRE(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_OK);
  CHECK(contains(logged.c_str(), "issue 106"));
  stgs_issue issue{};
  issue.struct_size = sizeof issue;
  REQUIRE(stgs_scene_get_issue(scene.get(), 0, &issue) == STGS_OK);
  CHECK(issue.number == 106);
  CHECK(stgs_scene_get_issue(scene.get(), 1000, &issue) == STGS_ERROR_ARGUMENT);

  settings.reject_damage = 1;
  const ScenePtr strict = make_scene(&settings);
  CHECK(stgs_scene_open_memory(strict.get(), file.data(), file.size()) == STGS_ERROR_INVALID_FILE);
  CHECK(error_of(strict.get()).issue == 106);
}

TEST_CASE("a file above a limit is rejected with a message that names the limit", "[sdk]") {
  const auto file = sdk_file();
  stgs_scene_settings settings = scene_settings();
  const auto open_result = [&] {
    const ScenePtr scene = make_scene(&settings);
    const stgs_result result = stgs_scene_open_memory(scene.get(), file.data(), file.size());
    CHECK(contains(error_of(scene.get()).message, "limit"));
    return result;
  };
  SECTION("bytes") {
    settings.max_file_bytes = file.size() - 1;
    CHECK(open_result() == STGS_ERROR_LIMIT);
  }
  SECTION("primitives") {
    settings.max_primitives = 499;
    CHECK(open_result() == STGS_ERROR_LIMIT);
  }
  SECTION("memory") {
    const auto large = encode_scene(random_scene(60000, 0, 30, 4), {});
    REQUIRE(large.ok());
    settings.memory_budget = std::uint64_t{4} << 20;
    const ScenePtr scene = make_scene(&settings);
    stgs_result result = stgs_scene_open_memory(scene.get(), large->data(), large->size());
    if (result == STGS_OK) {
      const RendererPtr renderer = cpu_renderer();
      stgs_view view;
      REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
      REQUIRE(stgs_view_resize(&view, 64, 36) == STGS_OK);
      std::vector<std::uint8_t> pixels(4 * 64 * 36);
      stgs_image image = empty_image();
      image.rgba8 = {pixels.data(), 0, pixels.size()};
      result = stgs_render(renderer.get(), scene.get(), 0.5, &view, &image, 1);
      CHECK(contains(error_of(renderer.get()).message, "limit"));
    }
    CHECK(result == STGS_ERROR_LIMIT);
  }
}

TEST_CASE("a failing source is reported and closed once", "[sdk]") {
  int closed = 0;
  stgs_io io{};
  io.struct_size = sizeof io;
  io.user = &closed;
  io.size = 100000;
  io.read = [](void*, std::uint64_t, void*, std::size_t) { return 42; };
  io.close = [](void* user) { ++*static_cast<int*>(user); };
  const ScenePtr scene = make_scene();
  CHECK(stgs_scene_open_io(scene.get(), &io) == STGS_ERROR_IO);
  CHECK(contains(error_of(scene.get()).message, "failed with error 42"));
  CHECK(closed == 1);
  io.read = nullptr;
  CHECK(stgs_scene_open_io(scene.get(), &io) == STGS_ERROR_ARGUMENT);
  CHECK(closed == 1);
}

TEST_CASE("an unavailable backend is reported and logged", "[sdk]") {
  std::string logged;
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.log_user = &logged;
  settings.log = [](void* user, stgs_log_level, const char* message) {
    *static_cast<std::string*>(user) += message;
  };
  stgs_renderer* renderer = nullptr;
  for (const stgs_backend backend : {STGS_BACKEND_CUDA, STGS_BACKEND_VULKAN}) {
    settings.backend = backend;
    logged.clear();
    const stgs_result result = stgs_renderer_create(&settings, &renderer);
    const RendererPtr owner(renderer);
    CHECK((result == STGS_OK) == (renderer != nullptr));
    CHECK(
        (result == STGS_OK || result == STGS_ERROR_NOT_BUILT || result == STGS_ERROR_UNSUPPORTED));
    CHECK_FALSE(logged.empty());
  }
  settings.backend = 9;
  CHECK(stgs_renderer_create(&settings, &renderer) == STGS_ERROR_ARGUMENT);
  CHECK(renderer == nullptr);
  settings.backend = STGS_BACKEND_AUTO;
  REQUIRE(stgs_renderer_create(&settings, &renderer) == STGS_OK);
  const RendererPtr owner(renderer);
  stgs_backend backend = STGS_BACKEND_AUTO;
  REQUIRE(stgs_renderer_get_backend(renderer, &backend) == STGS_OK);
  CHECK(backend != STGS_BACKEND_AUTO);
}

}  // namespace stgs::testing
