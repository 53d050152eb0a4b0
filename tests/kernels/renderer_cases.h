// SPDX-License-Identifier: Apache-2.0
// Scenes, views and comparisons shared by the renderer_*_cases.cpp.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "frame_difference.h"
#include "renderer_under_test.h"
#include "stgs/player/renderer.h"

namespace stgs::testing {

inline constexpr std::uint32_t kFrames = 60;

inline void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

inline std::unique_ptr<player::Renderer> device_renderer(const UnderTest& settings = {}) {
  auto renderer = make_renderer_under_test(settings);
  check(renderer.status());
  return std::move(*renderer);
}

inline std::unique_ptr<player::Renderer> cpu_renderer() {
  return std::move(*player::make_renderer("cpu"));
}

inline std::unique_ptr<player::Timeline> make_timeline(
    const Scene& scene, double chunk_seconds = 0.3,
    std::uint64_t budget = player::kDefaultMemoryBudget) {
  WriteSettings settings;
  settings.chunk_seconds = chunk_seconds;
  auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  return player::Timeline::from_reader(std::move(*reader), "the scene", budget);
}

// A view of random_scene (scene_fixture.h) from near the origin, almost along z.
inline player::View make_view(int width, int height) {
  player::View view{};
  view.camera.rotation = math::rotation_of({0.99f, 0.02f, -0.05f, 0.03f});
  view.camera.translation = {0.1f, -0.05f, 0.2f};
  view.camera.width = static_cast<float>(width);
  view.camera.height = static_cast<float>(height);
  view.camera.fx = 0.9f * static_cast<float>(std::max(width, height));
  view.camera.fy = 1.01f * view.camera.fx;
  view.camera.cx = 0.51f * view.camera.width;
  view.camera.cy = 0.48f * view.camera.height;
  view.camera.near_plane = 0.2f;
  view.background = {0.2f, 0.5f, 0.7f};
  return view;
}

inline std::vector<player::Frame> render_views(player::Renderer& renderer,
                                               player::Timeline& timeline, double seconds,
                                               const std::vector<player::View>& views,
                                               player::RenderStats* stats = nullptr) {
  std::vector<player::Frame> frames;
  check(renderer.render(timeline, seconds, views, frames, stats));
  REQUIRE(frames.size() == views.size());
  return frames;
}

// Renders on the device and on the CPU; checks the frames and the numbers of primitives.
inline void check_matches_cpu(player::Timeline& timeline, double seconds,
                              const std::vector<player::View>& views, player::Renderer& device) {
  const auto cpu = cpu_renderer();
  player::RenderStats expected, found;
  const std::vector<player::Frame> a = render_views(*cpu, timeline, seconds, views, &expected);
  const std::vector<player::Frame> b = render_views(device, timeline, seconds, views, &found);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const FrameDifference d = difference(a[i], b[i]);
    INFO(views[i].camera.width << "x" << views[i].camera.height << " at " << seconds
                               << " s: " << d.text());
    CHECK(d.agrees());
  }
  const auto near = [](std::size_t x, std::size_t y) {
    return std::max(x, y) - std::min(x, y) <= 2 + x / 1000;
  };
  INFO("active: " << found.active << " (CPU " << expected.active << "), splats: " << found.splats
                  << " (CPU " << expected.splats << ")");
  CHECK(near(expected.active, found.active));
  CHECK(near(expected.splats, found.splats));
}

// Whether two frames have the same bits.
inline bool identical(const player::Frame& a, const player::Frame& b) {
  return a.colour.data == b.colour.data && a.alpha.data == b.alpha.data &&
         a.depth.data == b.depth.data;
}

// n static primitives that are active and nearly opaque through the clip.
inline Scene static_scene(std::size_t n) {
  Scene scene = random_scene(n, 0, kFrames, 77);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1000.0f);
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 2.0f);
  return scene;
}

}  // namespace stgs::testing
