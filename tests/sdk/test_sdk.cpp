// SPDX-License-Identifier: Apache-2.0
// The C API: scene metadata, sources of a scene, and rendering into the caller's memory.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <thread>

#include "sdk_fixture.h"
#include "stgs/format/raster.h"
#include "stgs/stgs_cuda.h"

namespace stgs::testing {

TEST_CASE("a scene reports the metadata of its file", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  REQUIRE(stgs_scene_get_info(scene.get(), &info) == STGS_OK);
  CHECK(info.format_major == kFormatMajor);
  CHECK(info.frames == 30);
  CHECK(info.time_base_numerator == 1);
  CHECK(info.time_base_denominator == 30);
  CHECK(info.duration_seconds == Approx(1));
  CHECK(info.complete_seconds == Approx(1));
  CHECK(info.primitives == 500);
  CHECK(info.file_bytes == file.size());
  CHECK(info.sh_degree == 1);
  CHECK(info.has_start_camera == 1);
  CHECK(info.issues == 0);
  CHECK(info.bounds_min[2] >= 3);
  CHECK(info.bounds_max[2] <= 7);
  const char* text = nullptr;
  REQUIRE(stgs_scene_get_text(scene.get(), STGS_TEXT_TITLE, &text) == STGS_OK);
  CHECK(std::string(text) == "random scene");
  REQUIRE(stgs_scene_get_text(scene.get(), STGS_TEXT_AUDIO, &text) == STGS_OK);
  CHECK(std::string(text).empty());
  const stgs_view view = start_view(scene.get());
  CHECK(view.width == kSdkWidth);
  CHECK(view.fx == 60);
  CHECK(view.near_plane == 0.1f);
}

TEST_CASE("a scene renders the same from memory, from a copy and through callbacks", "[sdk]") {
  struct Source {
    std::vector<std::uint8_t> bytes;
    int closed = 0;
  } source{sdk_file()};
  stgs_io io{};
  io.struct_size = sizeof io;
  io.user = &source;
  io.size = source.bytes.size();
  io.read = [](void* user, std::uint64_t offset, void* out, std::size_t bytes) {
    std::memcpy(out, static_cast<Source*>(user)->bytes.data() + offset, bytes);
    return 0;
  };
  io.close = [](void* user) { ++static_cast<Source*>(user)->closed; };
  const RendererPtr renderer = cpu_renderer();
  const ScenePtr borrowed = open_scene(source.bytes);
  const stgs_view view = start_view(borrowed.get());
  const auto expected = render_rgba8(renderer.get(), borrowed.get(), 0.4, view);

  const ScenePtr copied = make_scene();
  {
    const auto temporary = source.bytes;
    REQUIRE(stgs_scene_open_memory_copy(copied.get(), temporary.data(), temporary.size()) ==
            STGS_OK);
  }
  CHECK(render_rgba8(renderer.get(), copied.get(), 0.4, view) == expected);

  ScenePtr from_callbacks = make_scene();
  REQUIRE(stgs_scene_open_io(from_callbacks.get(), &io) == STGS_OK);
  CHECK(render_rgba8(renderer.get(), from_callbacks.get(), 0.4, view) == expected);
  // Opening an open scene fails and does not close the source.
  CHECK(stgs_scene_open_io(from_callbacks.get(), &io) == STGS_ERROR_STATE);
  CHECK(source.closed == 0);
  from_callbacks.reset();
  CHECK(source.closed == 1);
}

TEST_CASE("images match the rasteriser for every row stride", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  stgs_view views[2] = {start_view(scene.get()), start_view(scene.get())};
  REQUIRE(stgs_view_stretch(&views[1], 33, 17) == STGS_OK);
  views[1].background[0] = 1;

  auto read = read_scene(memory_source(file));
  REQUIRE(read.ok());
  stgs_image images[2] = {empty_image(), empty_image()};
  constexpr std::size_t kStride = 300, kGuard = 0xA5;
  std::vector<std::uint8_t> rgba(kStride * kSdkHeight, kGuard);
  // The buffer ends with the last row, without its padding.
  images[0].rgba8 = {rgba.data(), kStride, kStride * (kSdkHeight - 1) + 4 * kSdkWidth};
  std::vector<float> planes[5];
  for (auto& plane : planes) plane.assign(33 * 17, -1.0f);
  const auto buffer = [&](int i) {
    return stgs_buffer{planes[i].data(), 0, planes[i].size() * sizeof(float)};
  };
  for (int c = 0; c < 3; ++c) images[1].rgb[c] = buffer(c);
  images[1].alpha = buffer(3);
  images[1].depth = buffer(4);
  REQUIRE(stgs_render(renderer.get(), scene.get(), 0.5, views, images, 2) == STGS_OK);

  SplatFrame splats;
  RasterOutput expected;
  StartCamera camera = *read->metadata.start_camera;
  render(read->gaussians, 15, pinhole_of(camera, 0.1f), {}, splats, expected);
  int wrong = 0, visible = 0;
  for (std::uint32_t y = 0; y < kSdkHeight; ++y) {
    for (std::uint32_t x = 0; x < kSdkWidth; ++x) {
      const std::uint8_t* pixel = rgba.data() + y * kStride + 4 * x;
      const std::size_t i = y * kSdkWidth + x;
      for (int c = 0; c < 3; ++c) {
        const float value = std::clamp(expected.colour.plane(c)[i], 0.0f, 1.0f) * 255;
        if (std::abs(static_cast<float>(pixel[c]) - value) > 0.51f) ++wrong;
      }
      if (std::abs(static_cast<float>(pixel[3]) - 255 * expected.alpha.plane(0)[i]) > 0.51f)
        ++wrong;
      if (pixel[3] > 100) ++visible;
    }
    for (std::size_t x = 4 * kSdkWidth; x < kStride; ++x) {
      if (rgba[y * kStride + x] != kGuard) ++wrong;
    }
  }
  CHECK(wrong == 0);
  CHECK(visible > 300);

  camera.fx *= 33.0f / kSdkWidth;
  camera.cx *= 33.0f / kSdkWidth;
  camera.fy *= 17.0f / kSdkHeight;
  camera.cy *= 17.0f / kSdkHeight;
  camera.width = 33;
  camera.height = 17;
  RasterSettings settings;
  settings.background = {1, 0, 0};
  render(read->gaussians, 15, pinhole_of(camera, 0.1f), settings, splats, expected);
  float max_difference = 0;
  for (std::size_t i = 0; i < planes[0].size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      max_difference =
          std::max(max_difference, std::abs(planes[c][i] - expected.colour.plane(c)[i]));
    }
    max_difference = std::max(max_difference, std::abs(planes[3][i] - expected.alpha.plane(0)[i]));
    max_difference =
        std::max(max_difference, std::abs(planes[4][i] - expected.depth.plane(0)[i]) / 10);
  }
  CHECK(max_difference < 1e-4f);
}

TEST_CASE("a foveated image is identical within the fovea and close outside it", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  stgs_view view = start_view(scene.get());
  REQUIRE(stgs_view_resize(&view, 4 * kSdkWidth, 4 * kSdkHeight) == STGS_OK);
  const auto full = render_rgba8(renderer.get(), scene.get(), 0.5, view);
  stgs_view with_fovea = view;
  with_fovea.fovea_x = 100;
  with_fovea.fovea_y = 80;
  // A radius of 0 disables foveation.
  CHECK(render_rgba8(renderer.get(), scene.get(), 0.5, with_fovea) == full);
  with_fovea.fovea_radius = 50;
  check_foveated(full, render_rgba8(renderer.get(), scene.get(), 0.5, with_fovea), with_fovea);

  REQUIRE(stgs_view_stretch(&with_fovea, 8 * kSdkWidth, 2 * kSdkHeight) == STGS_OK);
  CHECK(with_fovea.fovea_x == 200);
  CHECK(with_fovea.fovea_y == 40);
  CHECK(with_fovea.fovea_radius == 50);
  for (const auto member : {&stgs_view::fovea_x, &stgs_view::fovea_y, &stgs_view::fovea_radius}) {
    stgs_view wrong = with_fovea;
    wrong.*member = NAN;
    stgs_image image = empty_image();
    std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
    image.rgba8 = {pixels.data(), 0, pixels.size()};
    CHECK(stgs_render(renderer.get(), scene.get(), 0, &wrong, &image, 1) == STGS_ERROR_ARGUMENT);
    CHECK(stgs_view_resize(&wrong, kSdkWidth, kSdkHeight) == STGS_ERROR_ARGUMENT);
  }
  stgs_view wide = view;
  wide.fx = 3e38f;
  CHECK(stgs_view_stretch(&wide, 32768, kSdkHeight) == STGS_ERROR_ARGUMENT);
  CHECK(wide.width == view.width);
  CHECK(wide.fx == 3e38f);
}

TEST_CASE("two threads render two scenes concurrently", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  const stgs_view view = start_view(scene.get());
  std::vector<std::vector<std::uint8_t>> expected;
  for (int i = 0; i < 4; ++i) {
    expected.push_back(render_rgba8(renderer.get(), scene.get(), 0.25 * i, view));
  }
  int wrong[2] = {0, 0};
  const auto render_all = [&](int& count) {
    const ScenePtr own = open_scene(file);
    const RendererPtr own_renderer = cpu_renderer();
    for (int i = 0; i < 8; ++i) {
      std::vector<std::uint8_t> pixels(expected[0].size());
      stgs_image image{};
      image.struct_size = sizeof image;
      image.rgba8 = {pixels.data(), 0, pixels.size()};
      if (stgs_render(own_renderer.get(), own.get(), 0.25 * (i % 4), &view, &image, 1) != STGS_OK ||
          pixels != expected[i % 4]) {
        ++count;
      }
    }
  };
  std::thread other([&] { render_all(wrong[1]); });
  render_all(wrong[0]);
  other.join();
  CHECK(wrong[0] == 0);
  CHECK(wrong[1] == 0);
}

TEST_CASE("a CPU renderer refuses to render into CUDA memory", "[sdk]") {
  const auto file = sdk_file();
  const ScenePtr scene = open_scene(file);
  const RendererPtr renderer = cpu_renderer();
  const stgs_view view = start_view(scene.get());
  std::vector<std::uint8_t> pixels(std::size_t{4} * view.width * view.height);
  stgs_image image = empty_image();
  image.rgba8 = {pixels.data(), 0, pixels.size()};
  CHECK(stgs_cuda_render(renderer.get(), scene.get(), 0, &view, &image, 1, nullptr) ==
        STGS_ERROR_UNSUPPORTED);
  CHECK(std::string(error_of(renderer.get()).message).find("STGS_BACKEND_CUDA") !=
        std::string::npos);
  CHECK(stgs_cuda_render(nullptr, scene.get(), 0, &view, &image, 1, nullptr) ==
        STGS_ERROR_ARGUMENT);
}

}  // namespace stgs::testing
