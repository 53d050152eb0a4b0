// SPDX-License-Identifier: Apache-2.0
// Every struct of the C API, shorter and longer than in this version's headers, as programs built
// with other versions pass them.
#include <map>

#include "sdk_player_fixture.h"
#include "struct_sizes.h"

namespace stgs::testing {
namespace {

// The objects that the structs are passed to.
struct Objects {
  std::vector<std::uint8_t> file = sdk_file();
  ScenePtr scene = open_scene(file);
  RendererPtr renderer = cpu_renderer();
  PlayerPtr player = open_player(file);
  stgs_view view = start_view(scene.get());
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(4 * kSdkWidth * kSdkHeight);

  stgs_image image() {
    stgs_image out = empty_image();
    out.rgba8 = {pixels.data(), 0, pixels.size()};
    return out;
  }
  stgs_result render(const stgs_view* with, const stgs_image* output) {
    return stgs_render(renderer.get(), scene.get(), 0.4, with, output, 1);
  }
};

template <typename Settings>
stgs_result create_scene(const Settings& settings) {
  stgs_scene* created = nullptr;
  const stgs_result result = stgs_scene_create(settings, &created);
  stgs_scene_destroy(created);
  return result;
}
stgs_result create_player(const stgs_player_settings* settings) {
  stgs_player* created = nullptr;
  const stgs_result result = stgs_player_create(settings, &created);
  stgs_player_destroy(created);
  return result;
}
stgs_result create_renderer(const stgs_renderer_settings* settings) {
  stgs_renderer* created = nullptr;
  const stgs_result result = stgs_renderer_create(settings, &created);
  stgs_renderer_destroy(created);
  return result;
}

void check_sources(Objects& objects) {
  FaultySource file(objects.file);
  check_input_struct("stgs_io", file.io(), offsetof(stgs_io, close), [&](const stgs_io* io) {
    const stgs_result opened = stgs_scene_open_io(make_scene().get(), io);
    const PlayerPtr player = make_player();
    const stgs_result begun = stgs_player_open_io(player.get(), io);
    return begun == STGS_OK && stgs_player_wait_open(player.get()) != STGS_OK ? STGS_ERROR_IO
           : begun == opened                                                  ? opened
                                                                              : STGS_ERROR_RUNTIME;
  });
  check_input_struct("stgs_async_io", file.async_io(), offsetof(stgs_async_io, interrupt),
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
  check_input_struct("stgs_task_runner", runner, sizeof runner, [](const stgs_task_runner* passed) {
    stgs_renderer_settings settings;
    REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
    settings.task_runner = passed;
    return create_renderer(&settings);
  });
  stgs_allocator allocator{};
  allocator.allocate = [](void*, std::size_t bytes, std::size_t alignment) {
    return ::operator new(bytes, std::align_val_t(alignment));
  };
  allocator.free = [](void*, void* memory, std::size_t, std::size_t alignment) {
    ::operator delete(memory, std::align_val_t(alignment));
  };
  check_input_struct("stgs_allocator", allocator, sizeof allocator,
                     [](const stgs_allocator* passed) {
                       stgs_scene_settings settings = scene_settings();
                       settings.allocator = passed;
                       return create_scene(&settings);
                     });
}

// Checks the structs of stgs_contents.h with a function like check_output_struct().
template <typename Check>
void check_contents_structs(Objects& objects, const Check& check_output) {
  stgs_scene* scene = objects.scene.get();
  check_output("stgs_contents", stgs_contents{},
               [&](stgs_contents* out) { return stgs_scene_get_contents(scene, out); });
  check_output("stgs_part", stgs_part{},
               [&](stgs_part* part) { return stgs_scene_get_part(scene, 0, part); });
  check_output("stgs_segment", stgs_segment{},
               [&](stgs_segment* out) { return stgs_scene_get_segment(scene, 0, out); });
  check_output("stgs_stream", stgs_stream{},
               [&](stgs_stream* stream) { return stgs_scene_get_stream(scene, 0, stream); });
  check_output("stgs_decoder_needs", stgs_decoder_needs{}, [&](stgs_decoder_needs* needs) {
    return stgs_scene_get_decoder_needs(scene, needs);
  });
  check_output("stgs_scene_statistics", stgs_scene_statistics{},
               [&](stgs_scene_statistics* out) { return stgs_scene_get_statistics(scene, out); });
  const ScenePtr with_lost_fragment = make_scene();
  REQUIRE(stgs_scene_open(with_lost_fragment.get(), STGS_TEST_DATA
                          "/../conformance/vectors/fragment_damaged.stgs") == STGS_OK);
  check_output("stgs_lost_fragment", stgs_lost_fragment{}, [&](stgs_lost_fragment* lost) {
    return stgs_scene_get_lost_fragment(with_lost_fragment.get(), 0, lost);
  });
}

}  // namespace

TEST_CASE("structs of older and newer headers are read and written up to their size", "[sdk]") {
  Objects objects;
  std::set<std::string> covered;
  const auto check_input = [&](const char* name, const auto& value, std::size_t min_size,
                               auto&& use) {
    covered.insert(name);
    check_input_struct(name, value, min_size, use);
  };
  const auto check_output = [&]<typename T>(const char* name, T, auto&& use) {
    covered.insert(name);
    check_output_struct<T>(name, use);
  };
  check_input("stgs_scene_settings", scene_settings(), 16,
              [](const stgs_scene_settings* s) { return create_scene(s); });
  check_input("stgs_player_settings", player_settings(), 16, create_player);
  stgs_renderer_settings renderer_settings;
  REQUIRE(stgs_renderer_settings_defaults(&renderer_settings, sizeof renderer_settings) == STGS_OK);
  check_input("stgs_renderer_settings", renderer_settings, 16, create_renderer);
  check_input("stgs_view", objects.view, offsetof(stgs_view, near_plane) - 4,
              [&](const stgs_view* view) {
                const stgs_image image = objects.image();
                return objects.render(view, &image);
              });
  check_input("stgs_image", objects.image(), offsetof(stgs_image, rgb),
              [&](const stgs_image* image) { return objects.render(&objects.view, image); });
  stgs_primitives primitives;
  REQUIRE(stgs_primitives_defaults(&primitives, sizeof primitives) == STGS_OK);
  check_input("stgs_primitives", primitives, 16, [&](const stgs_primitives* output) {
    std::uint64_t count = 0;
    return stgs_scene_get_primitives(objects.scene.get(), 0.4, output, &count);
  });
  check_sources(objects);
  check_hooks();
  covered.insert({"stgs_io", "stgs_async_io", "stgs_task_runner", "stgs_allocator"});

  check_output("stgs_error", stgs_error{},
               [&](stgs_error* e) { return stgs_scene_error(objects.scene.get(), e); });
  check_output("stgs_scene_info", stgs_scene_info{}, [&](stgs_scene_info* info) {
    return stgs_scene_get_info(objects.scene.get(), info);
  });
  auto damaged = objects.file;
  damaged.resize(damaged.size() + 100);  // longer than its header states
  const ScenePtr with_issue = open_scene(damaged);
  check_output("stgs_issue", stgs_issue{},
               [&](stgs_issue* issue) { return stgs_scene_get_issue(with_issue.get(), 0, issue); });
  check_contents_structs(objects, check_output);
  covered.insert("stgs_histogram_bin");  // allocated by the library
  // In test_sdk_contents.cpp.
  covered.insert({"stgs_damaged_segment", "stgs_render_statistics"});
  check_output("stgs_player_status", stgs_player_status{}, [&](stgs_player_status* status) {
    return stgs_player_update(objects.player.get(), 0, status);
  });
  check_output("stgs_player_status", stgs_player_status{}, [&](stgs_player_status* status) {
    return stgs_player_get_status(objects.player.get(), status);
  });
  check_output("stgs_player_statistics", stgs_player_statistics{},
               [&](stgs_player_statistics* statistics) {
                 return stgs_player_get_statistics(objects.player.get(), statistics);
               });
  check_output("stgs_player_live", stgs_player_live{}, [&](stgs_player_live* live) {
    return stgs_player_get_live(objects.player.get(), live);
  });
  (void)take_events(objects.player.get());
  check_output("stgs_player_event", stgs_player_event{}, [&](stgs_player_event* event) {
    return stgs_player_next_event(objects.player.get(), event);
  });

  std::set<std::string> declared;
  for (const char* header :
       {"stgs.h", "stgs_contents.h", "stgs_hooks.h", "stgs_player.h", "stgs_scene.h"}) {
    declared.merge(sized_structs(std::string(STGS_SDK_HEADERS "/") + header));
  }
  CHECK(covered == declared);
}

TEST_CASE("defaults and views are written into structs of older and newer headers", "[sdk]") {
  Objects objects;
  const auto defaults = [](auto function) {
    return [=](auto* out) {
      const std::size_t size = out->struct_size;
      return function(out, size);
    };
  };
  check_output_struct<stgs_scene_settings>("settings", defaults(stgs_scene_settings_defaults));
  check_output_struct<stgs_player_settings>("settings", defaults(stgs_player_settings_defaults));
  check_output_struct<stgs_renderer_settings>("settings",
                                              defaults(stgs_renderer_settings_defaults));
  check_output_struct<stgs_view>("a view", defaults(stgs_view_defaults));
  check_output_struct<stgs_image>("an image", defaults(stgs_image_defaults));
  check_output_struct<stgs_primitives>("primitives", defaults(stgs_primitives_defaults));
  check_output_struct<stgs_view>(
      "a view", [&](stgs_view* view) { return stgs_scene_start_view(objects.scene.get(), view); });
  // Functions that read and write a view keep its size.
  for (std::size_t size = offsetof(stgs_view, fovea_x); size < sizeof(stgs_view) + 64; size += 8) {
    Sized<stgs_view> view(size, objects.view);
    CHECK(stgs_view_resize(view.get(), 128, 96) == STGS_OK);
    CHECK(view.get()->struct_size == size);
    CHECK(view.get()->width == 128);
    CHECK(stgs_scene_frame_view(objects.scene.get(), view.get()) == STGS_OK);
    CHECK(view.get()->struct_size == size);
  }
}

TEST_CASE("struct_size is the stride of an array of views", "[sdk]") {
  Objects objects;
  const auto render = [&](std::size_t size) {
    std::vector<unsigned char> views(2 * size);
    stgs_view view = objects.view;
    std::memcpy(views.data(), &view, std::min(size, sizeof view));
    view.translation[0] = 0.5f;
    std::memcpy(views.data() + size, &view, std::min(size, sizeof view));
    for (std::size_t i = 0; i < 2; ++i) std::memcpy(&views[i * size], &size, sizeof size);
    std::vector<std::uint8_t> other(objects.pixels.size());
    stgs_image images[2] = {objects.image(), objects.image()};
    images[1].rgba8.data = other.data();
    REQUIRE(stgs_render(objects.renderer.get(), objects.scene.get(), 0.4,
                        reinterpret_cast<const stgs_view*>(views.data()), images, 2) == STGS_OK);
    CHECK(objects.pixels != other);
    return std::pair(objects.pixels, other);
  };
  const auto expected = render(sizeof(stgs_view));
  CHECK(render(offsetof(stgs_view, fovea_x)) == expected);
  CHECK(render(sizeof(stgs_view) + 24) == expected);

  stgs_view views[2] = {objects.view, objects.view};
  views[1].struct_size = offsetof(stgs_view, fovea_x);
  const stgs_image images[2] = {objects.image(), objects.image()};
  CHECK(stgs_render(objects.renderer.get(), objects.scene.get(), 0.4, views, images, 2) ==
        STGS_ERROR_STRUCT_SIZE);
  CHECK(std::string(error_of(objects.renderer.get()).message).find("must have one struct_size") !=
        std::string::npos);
}

}  // namespace stgs::testing
