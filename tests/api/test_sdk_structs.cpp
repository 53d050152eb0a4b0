// SPDX-License-Identifier: Apache-2.0
// Every struct of the C interface, shorter and longer than this library's: programs are compiled
// with other versions of its headers.
#include <map>

#include "sdk_player_fixture.h"
#include "struct_sizes.h"

namespace stgs::testing {
namespace {

// What the structs are tried on.
struct Objects {
  std::vector<std::uint8_t> file = sdk_file();
  ScenePtr scene = open_scene(file);
  RendererPtr renderer = cpu_renderer();
  PlayerPtr player = open_player(file);
  stgs_view view = start_view(scene.get());
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(4 * kSdkWidth * kSdkHeight);

  stgs_image picture() {
    stgs_image out = empty_picture();
    out.rgba8 = {pixels.data(), 0, pixels.size()};
    return out;
  }
  stgs_result draw(const stgs_view* of, const stgs_image* into) {
    return stgs_render(renderer.get(), scene.get(), 0.4, of, into, 1);
  }
};

template <typename Settings>
stgs_result create_scene(const Settings& settings) {
  stgs_scene* made = nullptr;
  const stgs_result result = stgs_scene_create(settings, &made);
  stgs_scene_destroy(made);
  return result;
}
stgs_result create_player(const stgs_player_settings* settings) {
  stgs_player* made = nullptr;
  const stgs_result result = stgs_player_create(settings, &made);
  stgs_player_destroy(made);
  return result;
}
stgs_result create_renderer(const stgs_renderer_settings* settings) {
  stgs_renderer* made = nullptr;
  const stgs_result result = stgs_renderer_create(settings, &made);
  stgs_renderer_destroy(made);
  return result;
}

void check_sources(Objects& on) {
  CallerFile file(on.file);
  check_taken("stgs_io", file.io(), offsetof(stgs_io, close), [&](const stgs_io* io) {
    const stgs_result opened = stgs_scene_open_io(make_scene().get(), io);
    const PlayerPtr player = make_player();
    const stgs_result begun = stgs_player_open_io(player.get(), io);
    return begun == STGS_OK && stgs_player_wait_open(player.get()) != STGS_OK ? STGS_ERROR_IO
           : begun == opened                                                  ? opened
                                                                              : STGS_ERROR_RUNTIME;
  });
  check_taken("stgs_async_io", file.async_io(), offsetof(stgs_async_io, interrupt),
              [&](const stgs_async_io* io) {
                const PlayerPtr player = make_player();
                const stgs_result begun = stgs_player_open_async_io(player.get(), io);
                return begun == STGS_OK ? stgs_player_wait_open(player.get()) : begun;
              });
}

void check_hooks() {
  stgs_task_runner runner{};
  runner.run = [](void*, void (*task)(void*), void* argument, std::uint32_t) { task(argument); };
  runner.threads = 1;
  check_taken("stgs_task_runner", runner, sizeof runner, [](const stgs_task_runner* given) {
    stgs_renderer_settings settings;
    REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
    settings.task_runner = given;
    return create_renderer(&settings);
  });
  stgs_allocator allocator{};
  allocator.allocate = [](void*, std::size_t bytes, std::size_t alignment) {
    return ::operator new(bytes, std::align_val_t(alignment));
  };
  allocator.free = [](void*, void* memory, std::size_t, std::size_t alignment) {
    ::operator delete(memory, std::align_val_t(alignment));
  };
  check_taken("stgs_allocator", allocator, sizeof allocator, [](const stgs_allocator* given) {
    stgs_scene_settings settings = scene_settings();
    settings.allocator = given;
    return create_scene(&settings);
  });
}

}  // namespace

TEST_CASE("structs of older and newer programs are taken, and written as far as they go", "[sdk]") {
  Objects on;
  std::set<std::string> tried;
  const auto taken = [&](const char* name, const auto& value, std::size_t least, auto&& use) {
    tried.insert(name);
    check_taken(name, value, least, use);
  };
  const auto given = [&]<typename T>(const char* name, T, auto&& use) {
    tried.insert(name);
    check_given<T>(name, use);
  };
  taken("stgs_scene_settings", scene_settings(), 16,
        [](const stgs_scene_settings* s) { return create_scene(s); });
  taken("stgs_player_settings", player_settings(), 16, create_player);
  stgs_renderer_settings renderer_settings;
  REQUIRE(stgs_renderer_settings_defaults(&renderer_settings, sizeof renderer_settings) == STGS_OK);
  taken("stgs_renderer_settings", renderer_settings, 16, create_renderer);
  taken("stgs_view", on.view, offsetof(stgs_view, near_plane) - 4, [&](const stgs_view* view) {
    const stgs_image picture = on.picture();
    return on.draw(view, &picture);
  });
  taken("stgs_image", on.picture(), offsetof(stgs_image, rgb),
        [&](const stgs_image* picture) { return on.draw(&on.view, picture); });
  stgs_primitives primitives;
  REQUIRE(stgs_primitives_defaults(&primitives, sizeof primitives) == STGS_OK);
  taken("stgs_primitives", primitives, 16, [&](const stgs_primitives* wanted) {
    std::uint64_t count = 0;
    return stgs_scene_get_primitives(on.scene.get(), 0.4, wanted, &count);
  });
  check_sources(on);
  check_hooks();
  tried.insert({"stgs_io", "stgs_async_io", "stgs_task_runner", "stgs_allocator"});

  given("stgs_error", stgs_error{},
        [&](stgs_error* e) { return stgs_scene_error(on.scene.get(), e); });
  given("stgs_scene_info", stgs_scene_info{},
        [&](stgs_scene_info* info) { return stgs_scene_get_info(on.scene.get(), info); });
  auto damaged = on.file;
  damaged.resize(damaged.size() + 100);  // more than the file says
  const ScenePtr told = open_scene(damaged);
  given("stgs_issue", stgs_issue{},
        [&](stgs_issue* issue) { return stgs_scene_get_issue(told.get(), 0, issue); });
  given("stgs_contents", stgs_contents{},
        [&](stgs_contents* out) { return stgs_scene_get_contents(on.scene.get(), out); });
  given("stgs_part", stgs_part{},
        [&](stgs_part* part) { return stgs_scene_get_part(on.scene.get(), 0, part); });
  given("stgs_segment", stgs_segment{},
        [&](stgs_segment* out) { return stgs_scene_get_segment(on.scene.get(), 0, out); });
  given("stgs_stream", stgs_stream{},
        [&](stgs_stream* stream) { return stgs_scene_get_stream(on.scene.get(), 0, stream); });
  given("stgs_decoder_needs", stgs_decoder_needs{}, [&](stgs_decoder_needs* needs) {
    return stgs_scene_get_decoder_needs(on.scene.get(), needs);
  });
  given("stgs_scene_statistics", stgs_scene_statistics{},
        [&](stgs_scene_statistics* out) { return stgs_scene_get_statistics(on.scene.get(), out); });
  tried.insert("stgs_histogram_bin");  // the library's own
  // In test_sdk_contents.cpp.
  tried.insert({"stgs_damaged_segment", "stgs_render_statistics"});
  const ScenePtr torn = make_scene();
  REQUIRE(stgs_scene_open(torn.get(), STGS_TEST_DATA
                          "/../conformance/vectors/fragment_damaged.stgs") == STGS_OK);
  given("stgs_lost_fragment", stgs_lost_fragment{}, [&](stgs_lost_fragment* lost) {
    return stgs_scene_get_lost_fragment(torn.get(), 0, lost);
  });
  given("stgs_player_status", stgs_player_status{},
        [&](stgs_player_status* status) { return stgs_player_update(on.player.get(), 0, status); });
  given("stgs_player_statistics", stgs_player_statistics{}, [&](stgs_player_statistics* now) {
    return stgs_player_get_statistics(on.player.get(), now);
  });
  given("stgs_player_live", stgs_player_live{},
        [&](stgs_player_live* live) { return stgs_player_get_live(on.player.get(), live); });
  (void)take_events(on.player.get());
  given("stgs_player_event", stgs_player_event{},
        [&](stgs_player_event* event) { return stgs_player_next_event(on.player.get(), event); });

  std::set<std::string> declared;
  for (const char* header :
       {"stgs.h", "stgs_contents.h", "stgs_hooks.h", "stgs_player.h", "stgs_scene.h"}) {
    declared.merge(sized_structs(std::string(STGS_SDK_HEADERS "/") + header));
  }
  CHECK(tried == declared);
}

TEST_CASE("defaults and cameras are written into structs of any version", "[sdk]") {
  Objects on;
  const auto defaults = [](auto function) {
    return [=](auto* out) {
      const std::size_t size = out->struct_size;
      return function(out, size);
    };
  };
  check_given<stgs_scene_settings>("settings", defaults(stgs_scene_settings_defaults));
  check_given<stgs_player_settings>("settings", defaults(stgs_player_settings_defaults));
  check_given<stgs_renderer_settings>("settings", defaults(stgs_renderer_settings_defaults));
  check_given<stgs_view>("a view", defaults(stgs_view_defaults));
  check_given<stgs_image>("a picture", defaults(stgs_image_defaults));
  check_given<stgs_primitives>("primitives", defaults(stgs_primitives_defaults));
  check_given<stgs_view>(
      "a view", [&](stgs_view* view) { return stgs_scene_start_view(on.scene.get(), view); });
  // One that is read and written keeps its size.
  for (std::size_t size = offsetof(stgs_view, fovea_x); size < sizeof(stgs_view) + 64; size += 8) {
    Sized<stgs_view> view(size, on.view);
    CHECK(stgs_view_resize(view.get(), 128, 96) == STGS_OK);
    CHECK(view.get()->struct_size == size);
    CHECK(view.get()->width == 128);
    CHECK(stgs_scene_frame_view(on.scene.get(), view.get()) == STGS_OK);
    CHECK(view.get()->struct_size == size);
  }
}

TEST_CASE("views of an array lie as far apart as the program's header has them", "[sdk]") {
  Objects on;
  const auto draw = [&](std::size_t size) {
    std::vector<unsigned char> views(2 * size);
    stgs_view view = on.view;
    std::memcpy(views.data(), &view, std::min(size, sizeof view));
    view.translation[0] = 0.5f;
    std::memcpy(views.data() + size, &view, std::min(size, sizeof view));
    for (std::size_t i = 0; i < 2; ++i) std::memcpy(&views[i * size], &size, sizeof size);
    std::vector<std::uint8_t> other(on.pixels.size());
    stgs_image pictures[2] = {on.picture(), on.picture()};
    pictures[1].rgba8.data = other.data();
    REQUIRE(stgs_render(on.renderer.get(), on.scene.get(), 0.4,
                        reinterpret_cast<const stgs_view*>(views.data()), pictures, 2) == STGS_OK);
    CHECK(on.pixels != other);
    return std::pair(on.pixels, other);
  };
  const auto expected = draw(sizeof(stgs_view));
  CHECK(draw(offsetof(stgs_view, fovea_x)) == expected);
  CHECK(draw(sizeof(stgs_view) + 24) == expected);

  stgs_view views[2] = {on.view, on.view};
  views[1].struct_size = offsetof(stgs_view, fovea_x);
  const stgs_image pictures[2] = {on.picture(), on.picture()};
  CHECK(stgs_render(on.renderer.get(), on.scene.get(), 0.4, views, pictures, 2) ==
        STGS_ERROR_STRUCT_SIZE);
  CHECK(std::string(error_of(on.renderer.get()).message).find("must have one struct_size") !=
        std::string::npos);
}

}  // namespace stgs::testing
