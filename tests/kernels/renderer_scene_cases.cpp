// SPDX-License-Identifier: Apache-2.0
// A device's renderer against the CPU renderer (spec/representation.md, 7.2): scenes.
#include "fixtures/long_part.h"
#include "renderer_cases.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

TEST_CASE("random scenes of every SH degree and frame size match the CPU renderer") {
  const auto device = device_renderer();
  const int sizes[][2] = {{1, 1}, {16, 16}, {17, 33}, {101, 67}, {333, 211}};
  for (int degree = 0; degree <= 3; ++degree) {
    const Scene scene =
        random_scene(3000 + 57 * static_cast<std::size_t>(degree), degree, kFrames, 20 + degree);
    const auto timeline = make_timeline(scene);
    for (const auto& size : sizes)
      check_matches_cpu(*timeline, 0.97, {make_view(size[0], size[1])}, *device);
  }
}

TEST_CASE("times at, beyond and between the frames of the clip match the CPU renderer") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(4000, 1, kFrames, 5));
  const double length = timeline->duration_seconds();
  for (const double seconds :
       {0.0, length, 1e-9, length - 1e-9, 0.5 / 30, 1.2345, -0.5, length + 3}) {
    check_matches_cpu(*timeline, seconds, {make_view(128, 72)}, *device);
  }
}

TEST_CASE("a part far into a long timeline matches the CPU renderer") {
  constexpr std::uint32_t kLate = 1 << 20;
  Scene scene = random_scene(2000, 1, kFrames, 3);
  scene.metadata.time_base = {1, 1};
  scene.metadata.frames = kLate + kFrames;
  scene.parts = {{double(kLate), double(kLate) + kFrames, scene.gaussians.size()}};
  const auto timeline = make_timeline(scene, 8);
  const auto device = device_renderer();
  for (const double seconds : {0.0, 7.3, 44.001, 59.5}) {
    check_matches_cpu(*timeline, kLate + seconds, {make_view(96, 64)}, *device);
  }
}

TEST_CASE("content far into a long part is rendered as at the beginning of a short one") {
  const FarContent content = make_far_content(3000);
  const auto timeline_of = [](const std::vector<std::uint8_t>& bytes) {
    auto reader = SceneReader::open(memory_source(bytes));
    check(reader.status());
    return player::Timeline::from_reader(std::move(*reader));
  };
  const auto near = timeline_of(content.near), far = timeline_of(content.far);
  const auto on_near = device_renderer(), on_far = device_renderer();
  const std::vector<player::View> views = {make_view(160, 90)};
  RenderStats stats;
  for (const double ticks : {100.0, 101.375, 112.0, 118.53125}) {
    const auto expected = render_views(*on_near, *near, ticks, views, &stats);
    const auto found = render_views(*on_far, *far, ticks + content.shift, views);
    float greatest = 0;
    for (std::size_t p = 0; p < expected[0].colour.data.size(); ++p) {
      greatest = std::max(greatest, std::abs(expected[0].colour.data[p] - found[0].colour.data[p]));
    }
    INFO("tick " << ticks << ": differences up to " << greatest);
    CHECK(stats.splats > 100);
    CHECK(greatest <= 1e-3f);
    check_matches_cpu(*far, ticks + content.shift, views, *on_far);
  }
}

TEST_CASE("primitives behind the camera, near it and of extreme shapes match the CPU renderer") {
  const auto device = device_renderer();
  using Edit = std::function<void(Gaussians4D&, std::size_t)>;
  const std::pair<const char*, Edit> edits[] = {
      {"behind",
       [](Gaussians4D& s, std::size_t i) { s.position[3 * i + 2] -= i % 3 ? 12.0f : 5.0f; }},
      {"near",
       [](Gaussians4D& s, std::size_t i) {
         for (int c = 0; c < 3; ++c) s.position[3 * i + c] *= 0.05f;
       }},
      {"large",
       [](Gaussians4D& s, std::size_t i) {
         if (i % 50 == 0) s.log_scale[3 * i] = s.log_scale[3 * i + 1] = 2.0f;
       }},
      {"needles",
       [](Gaussians4D& s, std::size_t i) {
         s.log_scale[3 * i] = 0.5f;
         s.log_scale[3 * i + 1] = s.log_scale[3 * i + 2] = -9.0f;
       }},
      {"points",
       [](Gaussians4D& s, std::size_t i) {
         for (int c = 0; c < 3; ++c) s.log_scale[3 * i + c] = i % 2 ? -20.0f : -60.0f;
       }},
      {"faint",
       [](Gaussians4D& s, std::size_t i) { s.opacity_logit[i] = -5.6f + 0.2f * float(i % 5); }},
      {"opaque", [](Gaussians4D& s, std::size_t i) { s.opacity_logit[i] = 40.0f; }},
      {"brief",
       [](Gaussians4D& s, std::size_t i) {
         s.sigma[i] = 1e-4f;
         s.radius[i] = i % 2 ? 0.0f : 30.0f;
       }},
      {"fast", [](Gaussians4D& s, std::size_t i) { s.velocity[3 * i] = 40.0f; }},
      {"far",
       [](Gaussians4D& s, std::size_t i) {
         if (i % 4 != 0) return;
         s.position[3 * i + 2] = 1e12f;
         s.log_scale[3 * i] = 25.0f;
       }},
      {"one depth",
       [](Gaussians4D& s, std::size_t i) {
         for (int c = 0; c < 3; ++c) s.position[3 * i + c] = s.position[3 * (i % 7) + c];
       }},
      {"vivid",
       [](Gaussians4D& s, std::size_t i) {
         for (std::size_t k = 0; k < 12; ++k) s.sh[12 * i + k] *= 20.0f;
       }},
  };
  for (const auto& [name, edit] : edits) {
    INFO(name);
    Scene scene = random_scene(1500, 1, kFrames, 9);
    for (std::size_t i = 0; i < scene.gaussians.size(); ++i) edit(scene.gaussians, i);
    const auto timeline = make_timeline(scene);
    check_matches_cpu(*timeline, 1.0, {make_view(141, 93)}, *device);
  }
}

TEST_CASE("a scene without visible primitives renders as the background") {
  const auto device = device_renderer();
  Scene scene = random_scene(300, 2, kFrames, 4);
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i)
    scene.gaussians.position[3 * i + 2] = -50;
  const View view = make_view(40, 30);
  for (int kind = 0; kind < 3; ++kind) {
    if (kind == 1)
      std::fill(scene.gaussians.opacity_logit.begin(), scene.gaussians.opacity_logit.end(), -20.0f);
    if (kind == 2) scene.gaussians.resize(0);
    const auto timeline = make_timeline(scene);
    RenderStats stats;
    const std::vector<Frame> frames = render_views(*device, *timeline, 0.5, {view}, &stats);
    CHECK(stats.splats == 0);
    CHECK(frames[0].colour.plane(0)[7] == view.background.x);
    CHECK(frames[0].colour.plane(2)[40 * 30 - 1] == view.background.z);
    for (const float a : frames[0].alpha.data) REQUIRE(a == 0.0f);
    for (const float d : frames[0].depth.data) REQUIRE(d == 0.0f);
  }
}

TEST_CASE(
    "the few active primitives among many stored ones are rendered, whatever the segment sizes") {
  const auto device = device_renderer();
  for (const std::size_t n : {1, 255, 256, 257, 2047, 2048, 2049, 30000}) {
    Scene scene = random_scene(n, 1, kFrames, static_cast<unsigned>(70 + n));
    Gaussians4D& set = scene.gaussians;
    for (std::size_t i = 0; i < n; ++i) {
      set.sigma[i] = i % 5 == 0 ? 200.0f : 0.4f;
      set.radius[i] = 0.0f;
      set.opacity_logit[i] = 2.0f;
      // Every 25th primitive has the same position, so ids decide the order.
      for (std::size_t c = 0; c < 3 && i % 25 == 0; ++c) {
        set.position[3 * i + c] = set.position[c];
        set.velocity[3 * i + c] = 0.0f;
      }
    }
    for (const double chunk_seconds : {0.1, 10.0}) {
      INFO(n << " primitives in chunks of " << chunk_seconds << " s");
      const auto timeline = make_timeline(scene, chunk_seconds);
      check_matches_cpu(*timeline, 0.52, {make_view(90, 70)}, *device);
    }
  }
}

TEST_CASE("more chunks of primitives and views than a workgroup sums are rendered") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(140000, 0, kFrames, 33));
  const std::vector<View> views = {make_view(24, 20), make_view(33, 17), make_view(16, 16),
                                   make_view(40, 9)};
  check_matches_cpu(*timeline, 0.8, views, *device);
}

TEST_CASE("any number of splats at equal depths blend in the order of their ids") {
  const auto device = device_renderer(), variant = device_renderer({.variant = true});
  for (const std::size_t layers : {1, 700}) {
    Scene scene = static_scene(12000);
    std::fill(scene.gaussians.log_scale.begin(), scene.gaussians.log_scale.end(), -3.4f);
    for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
      scene.gaussians.position[3 * i + 2] = 4.0f + 1e-3f * static_cast<float>(i * 7919 % layers);
    }
    const auto timeline = make_timeline(scene);
    for (const int width : {60, 400}) {  // tile counts that take one and two sort passes
      View view = make_view(width, width / 2 + 7);
      view.camera.rotation = math::rotation_of({1, 0, 0, 0});  // so that depths are exactly equal
      check_matches_cpu(*timeline, 1.0, {view}, *device);
      CHECK(identical(render_views(*device, *timeline, 1.0, {view})[0],
                      render_views(*variant, *timeline, 1.0, {view})[0]));
    }
  }
}

TEST_CASE("a frame whose tile numbers need three radix digits matches the CPU renderer",
          "[large]") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(6000, 0, kFrames, 91));
  View view = make_view(32768, 560);
  check_matches_cpu(*timeline, 1.0, {view}, *device);
  view.fovea = Fovea{{20000.0f, 300.0f}, 12000.0f};  // most of the frame at full resolution
  check_matches_cpu(*timeline, 1.0, {view}, *device);
}

TEST_CASE("quantised scenes match the CPU renderer") {
  const auto device = device_renderer();
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  auto bytes = encode_scene(random_scene(20000, 3, kFrames, 31), settings);
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  const auto timeline = Timeline::from_reader(std::move(*reader));
  check_matches_cpu(*timeline, 1.3, {make_view(320, 180)}, *device);
}

TEST_CASE("scenes in other colour encodings match the CPU renderer") {
  const auto device = device_renderer();
  for (const auto& [primaries, transfer] : {std::pair{9, 1}, {12, 13}, {1, 8}}) {
    Scene scene = random_scene(2000, 1, kFrames, 32);
    scene.metadata.primaries = static_cast<std::uint8_t>(primaries);
    scene.metadata.transfer = static_cast<std::uint8_t>(transfer);
    auto bytes = encode_scene(scene, {});
    check(bytes.status());
    auto reader = SceneReader::open(memory_source(std::move(*bytes)));
    check(reader.status());
    const auto timeline = Timeline::from_reader(std::move(*reader));
    check_matches_cpu(*timeline, 1.3, {make_view(160, 90)}, *device);
  }
}

TEST_CASE("band-limited splats of all sizes match the CPU renderer") {
  const auto device = device_renderer();
  for (const float smaller : {0.0f, 1.5f, 4.0f}) {  // factor of the size, as a logarithm
    Scene scene = random_scene(4000, 1, kFrames, 33);
    scene.metadata.kernel = math::kBandLimited;
    for (float& log_scale : scene.gaussians.log_scale) log_scale -= smaller;
    auto bytes = encode_scene(scene, {});
    check(bytes.status());
    auto reader = SceneReader::open(memory_source(std::move(*bytes)));
    check(reader.status());
    const auto timeline = Timeline::from_reader(std::move(*reader));
    check_matches_cpu(*timeline, 1.3, {make_view(160, 90), make_view(320, 180)}, *device);
  }
}

TEST_CASE("a large frame of many primitives matches the CPU renderer", "[large]") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(400000, 3, kFrames, 41), 0.5);
  check_matches_cpu(*timeline, 0.7, {make_view(1920, 1080)}, *device);
  check_matches_cpu(*timeline, 1.4, {make_view(3840, 2160)}, *device);
}
