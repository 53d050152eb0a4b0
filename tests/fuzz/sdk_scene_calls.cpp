// SPDX-License-Identifier: Apache-2.0
// Calls of the target sdk on scenes and renderers.
#include <algorithm>
#include <cmath>

#include "sdk_calls.h"

namespace stgs::fuzz {
namespace {

// Lists the primitives at a time, into arrays for a few.
stgs_result list_primitives(stgs_scene* scene, std::uint8_t argument) {
  const std::size_t capacity = argument % 16;
  std::vector<float> opacity(capacity);
  std::vector<float> position(3 * capacity);
  stgs_primitives primitives;
  stgs_primitives_defaults(&primitives, sizeof primitives);
  primitives.capacity = capacity;
  primitives.opacity = opacity.data();
  primitives.position = position.data();
  std::uint64_t count = 0;
  const stgs_result result =
      stgs_scene_get_primitives(scene, extreme_number(argument / 16), &primitives, &count);
  for (std::size_t i = 0; result == STGS_OK && i < std::min<std::size_t>(count, capacity); ++i) {
    require(opacity[i] > 0 && opacity[i] <= 1, "listed primitives are visible");
  }
  return result;
}

// Whether an object that returned `result` has taken over the source.
bool is_taken(stgs_result result) {
  return result != STGS_ERROR_ARGUMENT && result != STGS_ERROR_STRUCT_SIZE &&
         result != STGS_ERROR_STATE;
}

}  // namespace

stgs_result query_scene(stgs_scene* scene, std::uint8_t argument) {
  stgs_scene_info info{};
  info.struct_size = sizeof info + argument % 2;
  stgs_issue issue{};
  issue.struct_size = sizeof issue;
  const char* text = nullptr;
  (void)stgs_scene_get_issue(scene, argument, &issue);
  if (stgs_scene_get_text(scene, argument % 4, &text) == STGS_OK) {
    require(text != nullptr, "a text is not null");
  }
  (void)list_primitives(scene, argument);
  return stgs_scene_get_info(scene, &info);
}

stgs_result SdkCalls::create_scene(std::uint8_t argument) {
  stgs_scene_settings settings;
  stgs_scene_settings_defaults(&settings, sizeof settings);
  settings.memory_budget = settings.max_memory = (argument & 1) != 0 ? 1 << 20 : 64 << 20;
  settings.max_primitives = (argument & 2) != 0 ? 100 : 1'000'000;
  settings.reject_damage = argument & 4;
  settings.struct_size -= (argument & 8) != 0 ? 4 : 0;
  settings.allocator = allocator();
  settings.log = log();
  destroy_scene();
  if ((argument & 16) == 0) return stgs_scene_create(&settings, &scene);
  return stgs_scene_create(ResizedStruct(settings, argument / 32).get(), &scene);
}

stgs_result SdkCalls::open_scene(std::uint8_t argument) {
  Bytes bytes = some_file(argument);
  if ((argument & 0x80) != 0) return stgs_scene_open_memory_copy(scene, bytes.data(), bytes.size());
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  // An open scene borrows the bytes, so they must not change.
  if (stgs_scene_get_info(scene, &info) != STGS_OK) scene_bytes = std::move(bytes);
  return stgs_scene_open_memory(scene, scene_bytes.data(), scene_bytes.size());
}

stgs_result SdkCalls::open_scene_source(std::uint8_t argument) {
  auto source = make_source(argument);
  stgs_io io = source->io();
  if ((argument & 0x80) != 0) io.struct_size -= 8;
  const stgs_result result = stgs_scene_open_io(scene, &io);
  require(source->is_closed() == (is_taken(result) && result != STGS_OK),
          "a source is closed if opening it failed, and only then");
  if (result == STGS_OK) scene_sources.push_back(std::move(source));
  return result;
}

void SdkCalls::destroy_scene() {
  stgs_scene_destroy(scene);
  scene = nullptr;
  release_sources(scene_sources);
}

stgs_result SdkCalls::create_renderer(std::uint8_t argument) {
  stgs_renderer_settings settings;
  stgs_renderer_settings_defaults(&settings, sizeof settings);
  settings.backend = argument % 3 == 0 ? 77 : STGS_BACKEND_CPU;
  settings.task_runner = runner();
  settings.log = log();
  stgs_renderer_destroy(renderer);
  return stgs_renderer_create(&settings, &renderer);
}

stgs_result SdkCalls::render(stgs_scene* rendered, std::uint8_t argument, std::uint8_t next) {
  stgs_view view;
  stgs_view_defaults(&view, sizeof view);
  (void)stgs_scene_start_view(rendered, &view);
  (void)stgs_view_resize(&view, 1 + argument % 40, 1 + next % 40);
  if ((argument & 0x40) != 0) view.fx = extreme_number(next);
  if ((argument & 0x80) != 0) view.translation[next % 3] = extreme_number(next);
  if ((next & 0x10) != 0 && stgs_scene_frame_view(rendered, &view) == STGS_OK) {
    require(std::isfinite(view.translation[next % 3]) && view.near_plane > 0,
            "a framed view is valid");
  }
  Bytes pixels(std::size_t{4} * view.width * view.height);
  stgs_image image;
  stgs_image_defaults(&image, sizeof image);
  image.rgba8 = {pixels.data(), (next & 0x20) != 0 ? next : 0u, pixels.size()};
  const float seconds = extreme_number(next);
  if (next < 0xC0) return stgs_render(renderer, rendered, seconds, &view, &image, 1);
  ResizedStruct resized_view(view, argument);
  ResizedStruct resized_image(image, next);
  return stgs_render(renderer, rendered, seconds, resized_view.get(), resized_image.get(), 1);
}

}  // namespace stgs::fuzz
