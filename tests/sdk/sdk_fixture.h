// SPDX-License-Identifier: Apache-2.0
// A small scene in memory, and RAII wrappers for the objects of the C API.
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/stgs.h"

namespace stgs::testing {

inline constexpr std::uint32_t kSdkWidth = 64, kSdkHeight = 48;

inline std::vector<std::uint8_t> sdk_file() {
  Scene scene = random_scene(500, 1, 30, 3);
  for (float& s : scene.gaussians.log_scale) s += 1.5f;  // large enough for a small image
  StartCamera start;
  start.fx = start.fy = 60;
  start.cx = kSdkWidth / 2.0f;
  start.cy = kSdkHeight / 2.0f;
  start.width = kSdkWidth;
  start.height = kSdkHeight;
  scene.metadata.start_camera = start;
  auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  return std::move(bytes).value();
}

struct DestroyScene {
  void operator()(stgs_scene* scene) const { stgs_scene_destroy(scene); }
};
struct DestroyRenderer {
  void operator()(stgs_renderer* renderer) const { stgs_renderer_destroy(renderer); }
};
using ScenePtr = std::unique_ptr<stgs_scene, DestroyScene>;
using RendererPtr = std::unique_ptr<stgs_renderer, DestroyRenderer>;

inline stgs_scene_settings scene_settings() {
  stgs_scene_settings settings;
  REQUIRE(stgs_scene_settings_defaults(&settings, sizeof settings) == STGS_OK);
  return settings;
}
inline ScenePtr make_scene(const stgs_scene_settings* settings = nullptr) {
  stgs_scene* scene = nullptr;
  REQUIRE(stgs_scene_create(settings, &scene) == STGS_OK);
  return ScenePtr(scene);
}
inline ScenePtr open_scene(const std::vector<std::uint8_t>& file) {
  ScenePtr scene = make_scene();
  REQUIRE(stgs_scene_open_memory(scene.get(), file.data(), file.size()) == STGS_OK);
  return scene;
}
inline RendererPtr cpu_renderer() {
  stgs_renderer_settings settings;
  REQUIRE(stgs_renderer_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.backend = STGS_BACKEND_CPU;
  stgs_renderer* renderer = nullptr;
  REQUIRE(stgs_renderer_create(&settings, &renderer) == STGS_OK);
  return RendererPtr(renderer);
}

inline stgs_error error_of(const stgs_scene* scene) {
  stgs_error error{};
  error.struct_size = sizeof error;
  REQUIRE(stgs_scene_error(scene, &error) == STGS_OK);
  return error;
}
inline stgs_error error_of(const stgs_renderer* renderer) {
  stgs_error error{};
  error.struct_size = sizeof error;
  REQUIRE(stgs_renderer_error(renderer, &error) == STGS_OK);
  return error;
}

inline stgs_view start_view(stgs_scene* scene) {
  stgs_view view{};
  view.struct_size = sizeof view;
  REQUIRE(stgs_scene_start_view(scene, &view) == STGS_OK);
  return view;
}
inline stgs_view small_view() {
  stgs_view view;
  REQUIRE(stgs_view_defaults(&view, sizeof view) == STGS_OK);
  REQUIRE(stgs_view_resize(&view, kSdkWidth, kSdkHeight) == STGS_OK);
  return view;
}
// An image without buffers.
inline stgs_image empty_image() {
  stgs_image image;
  REQUIRE(stgs_image_defaults(&image, sizeof image) == STGS_OK);
  return image;
}
inline bool contains(const std::string& text, const char* part) {
  return text.find(part) != std::string::npos;
}

// Renders tightly packed 8-bit RGBA.
inline std::vector<std::uint8_t> render_rgba8(stgs_renderer* renderer, stgs_scene* scene,
                                              double seconds, const stgs_view& view) {
  std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
  stgs_image image = empty_image();
  image.rgba8 = {pixels.data(), 0, pixels.size()};
  REQUIRE(stgs_render(renderer, scene, seconds, &view, &image, 1) == STGS_OK);
  return pixels;
}

// Compares a foveated render with the full one of the same time: the pixels within the view's fovea
// are identical, those outside differ slightly.
inline void check_foveated(const std::vector<std::uint8_t>& full,
                           const std::vector<std::uint8_t>& foveated, const stgs_view& view) {
  REQUIRE(foveated.size() == full.size());
  double squares = 0;
  std::size_t wrong = 0, inside = 0, outside = 0, changed = 0;
  for (std::uint32_t y = 0; y < view.height; ++y) {
    for (std::uint32_t x = 0; x < view.width; ++x) {
      const float dx = static_cast<float>(x) + 0.5f - view.fovea_x;
      const float dy = static_cast<float>(y) + 0.5f - view.fovea_y;
      const bool is_inside = dx * dx + dy * dy <= view.fovea_radius * view.fovea_radius;
      inside += is_inside ? 1 : 0;
      outside += is_inside ? 0 : 1;
      for (std::size_t c = 0; c < 4; ++c) {
        const std::size_t i = 4 * (std::size_t{y} * view.width + x) + c;
        const int difference = int{foveated[i]} - int{full[i]};
        wrong += is_inside && difference != 0 ? 1 : 0;
        changed += !is_inside && difference != 0 ? 1 : 0;
        squares += is_inside ? 0 : difference * difference;
      }
    }
  }
  CHECK(wrong == 0);
  CHECK(inside > 1000);
  CHECK(changed > outside / 4);
  const double psnr = 10 * std::log10(255.0 * 255.0 * 4 * static_cast<double>(outside) / squares);
  INFO(psnr << " dB outside the fovea");
  CHECK(psnr > 30);
}

}  // namespace stgs::testing
