// SPDX-License-Identifier: Apache-2.0
// A device's renderer against the CPU renderer (spec/representation.md, 7.2).
#include <chrono>
#include <functional>
#include <memory>
#include <thread>

#include "catch.h"
#include "frame_difference.h"
#include "renderer_under_test.h"
#include "scene_fixture.h"
#include "stgs/player/player.h"
#include "stgs/player/renderer.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

namespace {

constexpr std::uint32_t kFrames = 60;

void check(const Status& status) {
  INFO(status.message());
  REQUIRE(status.ok());
}

std::unique_ptr<Renderer> device_renderer(const UnderTest& settings = {}) {
  auto renderer = make_renderer_under_test(settings);
  check(renderer.status());
  return std::move(*renderer);
}

std::unique_ptr<Renderer> cpu_renderer() {
  return std::move(*make_renderer("cpu"));
}

std::unique_ptr<Timeline> timeline_over(const Scene& scene, double chunk_seconds = 0.3,
                                        std::uint64_t budget = kDefaultMemoryBudget) {
  WriteSettings settings;
  settings.chunk_seconds = chunk_seconds;
  auto bytes = encode_scene(scene, settings);
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  return Timeline::from_reader(std::move(*reader), "the scene", budget);
}

// Looks along z from the origin, a little askew, at what scene_fixture.h puts there.
View view_of(int width, int height) {
  View view{};
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

std::vector<Frame> draw(Renderer& renderer, Timeline& timeline, double seconds,
                        const std::vector<View>& views, RenderStats* stats = nullptr) {
  std::vector<Frame> frames;
  check(renderer.render(timeline, seconds, views, frames, stats));
  REQUIRE(frames.size() == views.size());
  return frames;
}

void check_alike(Timeline& timeline, double seconds, const std::vector<View>& views,
                 Renderer& device) {
  const auto cpu = cpu_renderer();
  RenderStats expected, found;
  const std::vector<Frame> a = draw(*cpu, timeline, seconds, views, &expected);
  const std::vector<Frame> b = draw(device, timeline, seconds, views, &found);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const FrameDifference d = difference(a[i], b[i]);
    INFO(views[i].camera.width << "x" << views[i].camera.height << " at " << seconds
                               << " s: " << d.text());
    CHECK(d.agrees());
  }
  const auto near = [](std::size_t x, std::size_t y) {
    return std::max(x, y) - std::min(x, y) <= 2 + x / 1000;
  };
  INFO("alive " << found.active << " for " << expected.active << ", drawn " << found.splats
                << " for " << expected.splats);
  CHECK(near(expected.active, found.active));
  CHECK(near(expected.splats, found.splats));
}

bool same(const Frame& a, const Frame& b) {
  return a.colour.data == b.colour.data && a.alpha.data == b.alpha.data &&
         a.depth.data == b.depth.data;
}

// One primitive that covers the middle of the view and lives through the clip.
Scene plain_scene(std::size_t n) {
  Scene scene = random_scene(n, 0, kFrames, 77);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1000.0f);
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 2.0f);
  return scene;
}

}  // namespace

TEST_CASE("random scenes of every degree and size look like the CPU's") {
  const auto device = device_renderer();
  const int sizes[][2] = {{1, 1}, {16, 16}, {17, 33}, {101, 67}, {333, 211}};
  for (int degree = 0; degree <= 3; ++degree) {
    const Scene scene =
        random_scene(3000 + 57 * static_cast<std::size_t>(degree), degree, kFrames, 20 + degree);
    const auto timeline = timeline_over(scene);
    for (const auto& size : sizes)
      check_alike(*timeline, 0.97, {view_of(size[0], size[1])}, *device);
  }
}

TEST_CASE("both ends of the time, moments beyond them, and those between frames are as the CPU's") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(4000, 1, kFrames, 5));
  const double length = timeline->duration_seconds();
  for (const double seconds :
       {0.0, length, 1e-9, length - 1e-9, 0.5 / 30, 1.2345, -0.5, length + 3}) {
    check_alike(*timeline, seconds, {view_of(128, 72)}, *device);
  }
}

TEST_CASE("a part far into a long timeline looks the same") {
  constexpr std::uint32_t kLate = 1 << 20;
  Scene scene = random_scene(2000, 1, kFrames, 3);
  scene.metadata.time_base = {1, 1};
  scene.metadata.frames = kLate + kFrames;
  scene.parts = {{double(kLate), double(kLate) + kFrames, scene.gaussians.size()}};
  const auto timeline = timeline_over(scene, 8);
  const auto device = device_renderer();
  for (const double moment : {0.0, 7.3, 44.001, 59.5}) {
    check_alike(*timeline, kLate + moment, {view_of(96, 64)}, *device);
  }
}

TEST_CASE("primitives behind the camera, near it, and of extreme shapes are as the CPU's") {
  const auto device = device_renderer();
  using Change = std::function<void(Gaussians4D&, std::size_t)>;
  const std::pair<const char*, Change> changes[] = {
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
  for (const auto& [name, change] : changes) {
    INFO(name);
    Scene scene = random_scene(1500, 1, kFrames, 9);
    for (std::size_t i = 0; i < scene.gaussians.size(); ++i) change(scene.gaussians, i);
    const auto timeline = timeline_over(scene);
    check_alike(*timeline, 1.0, {view_of(141, 93)}, *device);
  }
}

TEST_CASE("a scene in which nothing is seen is the background") {
  const auto device = device_renderer();
  Scene scene = random_scene(300, 2, kFrames, 4);
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i)
    scene.gaussians.position[3 * i + 2] = -50;
  const View view = view_of(40, 30);
  for (int kind = 0; kind < 3; ++kind) {
    if (kind == 1)
      std::fill(scene.gaussians.opacity_logit.begin(), scene.gaussians.opacity_logit.end(), -20.0f);
    if (kind == 2) scene.gaussians.resize(0);
    const auto timeline = timeline_over(scene);
    RenderStats stats;
    const std::vector<Frame> frames = draw(*device, *timeline, 0.5, {view}, &stats);
    CHECK(stats.splats == 0);
    CHECK(frames[0].colour.plane(0)[7] == view.background.x);
    CHECK(frames[0].colour.plane(2)[40 * 30 - 1] == view.background.z);
    for (const float a : frames[0].alpha.data) REQUIRE(a == 0.0f);
    for (const float d : frames[0].depth.data) REQUIRE(d == 0.0f);
  }
}

TEST_CASE("several views of a moment have the bits of the views one by one") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(2500, 3, kFrames, 8));
  std::vector<View> views = {view_of(64, 48), view_of(201, 32), view_of(64, 48), view_of(5, 97)};
  views[2].camera.translation.x += 0.3f;
  check_alike(*timeline, 1.1, views, *device);
  const std::vector<Frame> together = draw(*device, *timeline, 1.1, views);
  for (std::size_t i = 0; i < views.size(); ++i) {
    CHECK(same(draw(*device, *timeline, 1.1, {views[i]})[0], together[i]));
  }
}

TEST_CASE("two eyes with frusta askew are drawn as the CPU draws them, and as each alone") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(9000, 3, kFrames, 14));
  // As a headset's: off the centre both ways, what is between the eyes nearer to the picture's
  // edge.
  std::vector<View> eyes = {view_of(172, 184), view_of(172, 184)};
  for (int k = 0; k < 2; ++k) {
    math::PinholeCamera& camera = eyes[k].camera;
    camera.translation.x += k == 0 ? 0.03f : -0.03f;
    camera.cx += k == 0 ? 19.25f : -19.25f;
    camera.cy -= 11.5f;
    camera.fx *= k == 0 ? 1.0f : 1.02f;
  }
  for (const double seconds : {0.0, 0.81, 1.9}) {
    check_alike(*timeline, seconds, eyes, *device);
    const std::vector<Frame> both = draw(*device, *timeline, seconds, eyes);
    for (std::size_t k = 0; k < 2; ++k) {
      CHECK(same(draw(*device, *timeline, seconds, {eyes[k]})[0], both[k]));
    }
  }
}

TEST_CASE("away from where the eye looks pictures are at half resolution, as the CPU's") {
  const auto device = device_renderer(), variant = device_renderer({.variant = true});
  const auto timeline = timeline_over(random_scene(4000, 1, kFrames, 29));
  View left = view_of(333, 211), right = view_of(149, 100);
  left.fovea = Fovea{{140.5f, 97.0f}, 61.0f};
  right.fovea = Fovea{{-40.0f, 20.0f}, 0.0f};  // none of it at full resolution
  const View whole = view_of(101, 67);
  check_alike(*timeline, 0.97, {left, whole, right}, *device);
  check_alike(*timeline, 0.97, {left, right}, *variant);
  const auto same_by = [&](Renderer& a, const std::vector<View>& views, Renderer& b,
                           const std::vector<View>& others) {
    const std::vector<Frame> of_a = draw(a, *timeline, 0.97, views);
    const std::vector<Frame> of_b = draw(b, *timeline, 0.97, others);
    for (std::size_t i = 0; i < of_a.size(); ++i) CHECK(same(of_a[i], of_b[i]));
  };
  same_by(*device, {left, whole, right}, *variant, {left, whole, right});
  View everywhere = left, nowhere = left;
  everywhere.fovea->radius = 1e6f;
  nowhere.fovea.reset();
  same_by(*device, {everywhere}, *device, {nowhere});
}

TEST_CASE("a fovea may be anywhere, and of any size") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(2000, 1, kFrames, 31));
  View view = view_of(150, 115);
  const Fovea foveae[] = {{{75.0f, -1e9f}, 1e9f},
                          {{75.0f, 1e6f}, 1e6f},
                          {{1e30f, 0.0f}, 3e38f},
                          {{96.0f, 64.0f}, 32.0f},
                          {{-3e38f, 3e38f}, INFINITY}};
  for (const Fovea& fovea : foveae) {
    INFO("centre " << fovea.centre.x << ", " << fovea.centre.y << ", radius " << fovea.radius);
    view.fovea = fovea;
    check_alike(*timeline, 0.5, {view, view_of(40, 30)}, *device);
  }
}

TEST_CASE("beside a fovea and in it lists of any length are drawn") {
  const auto device = device_renderer();
  Scene scene = plain_scene(8000);
  Gaussians4D& set = scene.gaussians;
  // Faint ones in piles of 5200, 1500 and 500, a few pixels wide; the rest lies all over the view.
  const struct {
    std::size_t end;
    float x, y;
  } piles[] = {{5200, -1.5f, -1.0f}, {6700, 1.5f, -1.0f}, {7200, -1.4f, 1.2f}};
  std::size_t i = 0;
  for (const auto& pile : piles) {
    for (; i < pile.end; ++i) {
      const float at[] = {pile.x, pile.y, 5.0f};
      for (std::size_t c = 0; c < 3; ++c) {
        float& x = set.position[3 * i + c];
        x = at[c] + 0.05f * (x - (c == 2 ? 5.0f : 0.0f));
      }
      set.opacity_logit[i] = -3.0f;
    }
  }
  const auto timeline = timeline_over(scene);
  View aside = view_of(320, 240), on_pile = aside;
  aside.fovea = Fovea{{200.0f, 180.0f}, 40.0f};
  on_pile.fovea = Fovea{{80.0f, 70.0f}, 50.0f};
  check_alike(*timeline, 0.7, {aside, on_pile}, *device);
  View large = view_of(1037, 523);  // of more squares than a workgroup looks at
  large.fovea = Fovea{{260.0f, 150.0f}, 140.0f};
  check_alike(*timeline, 0.7, {large, on_pile}, *device);
  CHECK(same(draw(*device, *timeline, 0.7, {on_pile})[0],
             draw(*device, *timeline, 0.7, {aside, on_pile})[1]));
}

TEST_CASE("the number of views may change from call to call, and a view may see nothing") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(3000, 1, kFrames, 15));
  View away = view_of(70, 50);
  away.camera.translation.z = -1e4f;
  const View views[] = {view_of(33, 90), away, view_of(120, 16), view_of(48, 48)};
  std::vector<Frame> alone;
  for (const View& view : views) alone.push_back(draw(*device, *timeline, 0.6, {view})[0]);
  CHECK(*std::max_element(alone[1].alpha.data.begin(), alone[1].alpha.data.end()) == 0.0f);
  for (const std::size_t count : {4, 1, 3, 2, 4}) {
    const std::vector<Frame> frames =
        draw(*device, *timeline, 0.6, std::vector<View>(views, views + count));
    for (std::size_t i = 0; i < count; ++i) CHECK(same(frames[i], alone[i]));
  }
}

TEST_CASE("what is alive is found among many that are not, in segments of any size") {
  const auto device = device_renderer();
  for (const std::size_t n : {1, 255, 256, 257, 2047, 2048, 2049, 30000}) {
    Scene scene = random_scene(n, 1, kFrames, static_cast<unsigned>(70 + n));
    Gaussians4D& set = scene.gaussians;
    for (std::size_t i = 0; i < n; ++i) {
      set.sigma[i] = i % 5 == 0 ? 200.0f : 0.4f;
      set.radius[i] = 0.0f;
      set.opacity_logit[i] = 2.0f;
      // Some are at one place, where the order of ids decides.
      for (std::size_t c = 0; c < 3 && i % 25 == 0; ++c) {
        set.position[3 * i + c] = set.position[c];
        set.velocity[3 * i + c] = 0.0f;
      }
    }
    for (const double chunk_seconds : {0.1, 10.0}) {
      INFO(n << " primitives in chunks of " << chunk_seconds << " s");
      const auto timeline = timeline_over(scene, chunk_seconds);
      check_alike(*timeline, 0.52, {view_of(90, 70)}, *device);
    }
  }
}

TEST_CASE("more chunks of primitives and views than a workgroup sums are drawn") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(140000, 0, kFrames, 33));
  const std::vector<View> views = {view_of(24, 20), view_of(33, 17), view_of(16, 16),
                                   view_of(40, 9)};
  check_alike(*timeline, 0.8, views, *device);
}

TEST_CASE("pictures do not depend on runs, variants, or what was drawn before") {
  const auto one = device_renderer();
  const auto variant = device_renderer({.variant = true});
  const auto timeline = timeline_over(random_scene(6000, 2, kFrames, 12));
  const auto other = timeline_over(random_scene(500, 0, kFrames, 13));
  const View view = view_of(160, 90);
  std::vector<Frame> first;
  for (int k = 0; k < 6; ++k) first.push_back(draw(*one, *timeline, 0.3 * k, {view})[0]);
  draw(*one, *other, 0.1, {view_of(31, 200)});
  for (int k = 5; k >= 0; --k) {
    CHECK(same(draw(*one, *timeline, 0.3 * k, {view})[0], first[static_cast<std::size_t>(k)]));
    CHECK(same(draw(*variant, *timeline, 0.3 * k, {view})[0], first[static_cast<std::size_t>(k)]));
  }
}

TEST_CASE("splats at equal depths are blended in the order of ids, however many there are") {
  const auto device = device_renderer(), variant = device_renderer({.variant = true});
  for (const std::size_t layers : {1, 700}) {
    Scene scene = plain_scene(12000);
    std::fill(scene.gaussians.log_scale.begin(), scene.gaussians.log_scale.end(), -3.4f);
    for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
      scene.gaussians.position[3 * i + 2] = 4.0f + 1e-3f * static_cast<float>(i * 7919 % layers);
    }
    const auto timeline = timeline_over(scene);
    for (const int width : {60, 400}) {  // tiles for one and for two passes
      View view = view_of(width, width / 2 + 7);
      view.camera.rotation = math::rotation_of({1, 0, 0, 0});  // depths to the bit
      check_alike(*timeline, 1.0, {view}, *device);
      CHECK(same(draw(*device, *timeline, 1.0, {view})[0],
                 draw(*variant, *timeline, 1.0, {view})[0]));
    }
  }
}

TEST_CASE("a picture of more tiles than two digits tell looks like the CPU's", "[large]") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(6000, 0, kFrames, 91));
  View view = view_of(32768, 560);
  check_alike(*timeline, 1.0, {view}, *device);
  view.fovea = Fovea{{20000.0f, 300.0f}, 12000.0f};  // most of it at full resolution
  check_alike(*timeline, 1.0, {view}, *device);
}

TEST_CASE("a frame with more instances than there is room for is drawn again") {
  const auto roomy = device_renderer();
  const auto tight = device_renderer({.instances = 100});
  const auto timeline = timeline_over(plain_scene(2000));
  for (const int width : {100, 333, 50}) {
    const std::vector<View> views(width == 333 ? 3 : 1, view_of(width, 150));
    const std::vector<Frame> a = draw(*roomy, *timeline, 1.0, views);
    const std::vector<Frame> b = draw(*tight, *timeline, 1.0, views);
    for (std::size_t i = 0; i < views.size(); ++i) CHECK(same(a[i], b[i]));
  }
}

TEST_CASE("a view that needs more tiles than a frame can list is refused as by the CPU",
          "[large]") {
  Scene scene = plain_scene(1100);
  std::fill(scene.gaussians.log_scale.begin(), scene.gaussians.log_scale.end(), 6.0f);
  std::fill(scene.gaussians.opacity_logit.begin(), scene.gaussians.opacity_logit.end(), 5.0f);
  const auto timeline = timeline_over(scene);
  const auto device = device_renderer();
  View view = view_of(4096, 4096);
  view.camera.near_plane = 0.01f;
  const Status status = device->draw(*timeline, 1.5, {view}, nullptr);
  INFO(status.message());
  CHECK(status.code() == StatusCode::kRuntime);
  CHECK(status.message().find("(2^2") != std::string::npos);
  draw(*device, *timeline, 1.5, {view_of(64, 64)});
}

TEST_CASE("segments come and go within the timeline's budget") {
  const Scene scene = random_scene(6000, 1, kFrames, 21);
  const auto ample = timeline_over(scene);
  const auto tight = timeline_over(scene, 0.3, 600'000);
  const auto one = device_renderer(), other = device_renderer();
  const View view = view_of(90, 60);
  std::size_t most = 0;
  for (std::uint32_t k = 0, i = 11; k < kFrames; ++k, i = (i + 37) % kFrames) {
    RenderStats stats;
    const std::vector<Frame> a = draw(*one, *ample, i / 30.0, {view});
    CHECK(same(a[0], draw(*other, *tight, i / 30.0, {view}, &stats)[0]));
    most = std::max(most, stats.stored);
  }
  CHECK(most < scene.gaussians.size());
  const auto hopeless = timeline_over(scene, 0.3, 1000);
  const Status status = one->draw(*hopeless, 1.0, {view}, nullptr);
  CHECK(status.code() == StatusCode::kRuntime);
  CHECK(status.message().find("budget") != std::string::npos);
}

TEST_CASE("damaged segments are passed over, or refused, as by the CPU") {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = 0.3;
  auto bytes = encode_scene(random_scene(4000, 2, kFrames, 51), settings);
  check(bytes.status());
  const auto whole = SceneReader::open(memory_source(*bytes));
  check(whole.status());
  const auto& segments = (*whole)->segments();
  REQUIRE(segments.size() > 6);
  for (std::size_t k = 0; k < segments.size(); k += 3) {
    const SegmentInfo& s = segments[k];
    const std::uint64_t at = k % 2 == 0 && s.sh_bytes > 0 ? s.sh_offset + s.sh_bytes / 2
                                                          : s.offset + (s.bytes - s.sh_bytes) / 2;
    (*bytes)[at] ^= 0x55;
  }
  for (const DamagePolicy damaged : {DamagePolicy::kSkip, DamagePolicy::kReject}) {
    std::vector<Frame> frames[2];
    Status status[2];
    std::size_t losses[2];
    for (int k = 0; k < 2; ++k) {
      auto reader = SceneReader::open(memory_source(*bytes));
      check(reader.status());
      const auto timeline =
          Timeline::from_reader(std::move(*reader), "the scene", kDefaultMemoryBudget, damaged);
      const auto renderer = k == 0 ? cpu_renderer() : device_renderer();
      status[k] = renderer->render(*timeline, 1.0, {view_of(120, 80)}, frames[k], nullptr);
      losses[k] = timeline->segment_damage().size();
    }
    CHECK(status[0].code() == status[1].code());
    CHECK(losses[0] == losses[1]);
    CHECK((losses[0] > 0) == (damaged == DamagePolicy::kSkip));
    if (status[0].ok() && status[1].ok()) {
      const FrameDifference d = difference(frames[0][0], frames[1][0]);
      INFO(d.text());
      CHECK(d.agrees());
    }
  }
}

TEST_CASE("a scene that is still coming is drawn as far as it is there") {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  auto bytes = encode_scene(random_scene(5000, 2, kFrames, 61), settings);
  check(bytes.status());
  auto player = Player::from_source(memory_source(std::move(*bytes)));
  check(player.status());
  Timeline& timeline = (*player)->timeline();
  const auto device = device_renderer();
  check((*player)->seek(1.0));
  for (int k = 0; (*player)->layers() < (*player)->layer_count(); ++k) {
    REQUIRE(k < 2000);
    draw(*device, timeline, 1.0, {view_of(60, 40)});
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  check_alike(timeline, 1.0, {view_of(160, 90)}, *device);
}

TEST_CASE("quantised scenes look like the CPU's") {
  const auto device = device_renderer();
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  auto bytes = encode_scene(random_scene(20000, 3, kFrames, 31), settings);
  check(bytes.status());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  check(reader.status());
  const auto timeline = Timeline::from_reader(std::move(*reader));
  check_alike(*timeline, 1.3, {view_of(320, 180)}, *device);
}

TEST_CASE("a large picture of many primitives looks like the CPU's", "[large]") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(400000, 3, kFrames, 41), 0.5);
  check_alike(*timeline, 0.7, {view_of(1920, 1080)}, *device);
  check_alike(*timeline, 1.4, {view_of(3840, 2160)}, *device);
}

TEST_CASE("what the steps of a frame take is told where the backend counts it") {
  const auto device = device_renderer();
  CHECK(!device->profile().ok());
  const auto timeline = timeline_over(random_scene(5000, 2, kFrames, 16));
  const std::vector<View> views = {view_of(150, 90), view_of(64, 64)};
  const std::vector<Frame> before = draw(*device, *timeline, 1.2, views);
  const Result<RenderProfile> profile = device->profile();
  if (profile.status().code() == StatusCode::kUnsupported) return;
  check(profile.status());
  CHECK(profile->bytes_per_second > 1e9);
  REQUIRE(!profile->steps.empty());
  for (const RenderStep& step : profile->steps) {
    INFO(step.name << " " << step.ms << " ms, " << step.bytes << " bytes");
    CHECK(step.ms > 0);
    CHECK(step.bytes > 0);
  }
  if (device->name() != "vulkan") {  // which tells of no operations
    CHECK(profile->operations_per_second > 1e9);
    // Each pixel of a covered picture is evaluated; a contribution is an evaluation too.
    CHECK(profile->steps.back().operations > 150 * 90);
  }
  std::vector<Frame> after;
  check(device->read(after));
  for (std::size_t i = 0; i < views.size(); ++i) CHECK(same(before[i], after[i]));
}

TEST_CASE("what cannot be drawn is refused, and the renderer goes on") {
  const auto device = device_renderer();
  const auto timeline = timeline_over(random_scene(100, 0, kFrames, 2));
  const View view = view_of(32, 32);
  CHECK(device->draw(*timeline, 0, {}, nullptr).code() == StatusCode::kUsage);
  CHECK(device->draw(*timeline, 0, {view, view, view, view, view}, nullptr).code() ==
        StatusCode::kUsage);
  CHECK(device->draw(*timeline, NAN, {view}, nullptr).code() == StatusCode::kUsage);
  View narrow = view;
  narrow.fovea = Fovea{{16, 16}, -1};
  CHECK(device->draw(*timeline, 0, {narrow}, nullptr).code() == StatusCode::kUsage);
  narrow.fovea = Fovea{{NAN, 16}, 1};
  CHECK(device->draw(*timeline, 0, {narrow}, nullptr).code() == StatusCode::kUsage);
  std::vector<Frame> frames(3);
  check(device->read(frames));
  CHECK(frames.empty());
  draw(*device, *timeline, 0, {view});
}
