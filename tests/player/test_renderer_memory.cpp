// SPDX-License-Identifier: Apache-2.0
// The memory of the CPU renderer: charged before it is allocated, within the limit of the timeline.
// heap.cpp counts the allocations.
#include <algorithm>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "../fuzz/heap.h"
#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/player/renderer.h"

namespace stgs::player {
namespace {

constexpr auto kPool = Budget::Pool::kRenderer;
constexpr std::uint64_t kMiB = std::uint64_t{1} << 20;
constexpr double kTime = 1.0;  // seconds
// What is not charged: tasks, lists of pointers, list entries of a few tiles per thread.
constexpr std::uint64_t kUncharged = 2 * kMiB;

// n primitives that are active throughout, each of the same size: exp(log_scale).
std::unique_ptr<Timeline> make_timeline(std::size_t n, float log_scale) {
  Scene scene = testing::random_scene(n, 0, 60, 5);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.log_scale.begin(), set.log_scale.end(), log_scale);
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 1.0f);
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1000.0f);
  auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  REQUIRE(reader.ok());
  auto timeline = Timeline::from_reader(std::move(*reader), "the scene");
  REQUIRE(timeline->at(kTime).ok());  // decoded before anything is measured
  return timeline;
}

constexpr float kHuge = 6.0f, kTiny = -5.0f;  // covers any view; covers a few pixels

View make_view(int width, int height, float zoom = 1.0f) {
  View view{};
  view.camera.rotation = math::rotation_of({1.0f, 0.0f, 0.0f, 0.0f});
  view.camera.width = static_cast<float>(width);
  view.camera.height = static_cast<float>(height);
  view.camera.fx = view.camera.fy = zoom * view.camera.width;
  view.camera.cx = 0.5f * view.camera.width;
  view.camera.cy = 0.5f * view.camera.height;
  view.camera.near_plane = 0.2f;
  return view;
}

std::unique_ptr<Renderer> cpu_renderer() {
  return std::move(*make_renderer("cpu"));
}

struct Drawn {
  Status status;
  std::uint64_t heap = 0;  // peak
};

Drawn draw(Renderer& renderer, Timeline& timeline, const std::vector<View>& views) {
  Drawn out;
  fuzz::limit_heap(std::uint64_t{1} << 32);
  out.status = renderer.draw(timeline, kTime, views, nullptr);
  out.heap = fuzz::heap_peak();
  fuzz::unlimit_heap();
  return out;
}

std::vector<float> colour_of(Renderer& renderer, Timeline& timeline, const View& view) {
  std::vector<Frame> frames;
  const Status status = renderer.render(timeline, kTime, {view}, frames, nullptr);
  INFO(status.message());
  REQUIRE(status.ok());
  return frames[0].colour.data;
}

}  // namespace

TEST_CASE("a renderer may take the memory budget, and always 1 GiB") {
  const auto limit_of = [](std::uint64_t budget) {
    auto bytes = encode_scene(testing::random_scene(10, 0, 30, 5), {});
    auto reader = SceneReader::open(memory_source(std::move(*bytes)));
    const auto timeline = Timeline::from_reader(std::move(*reader), "the scene", budget);
    CHECK(timeline->budget()->usage(Budget::Pool::kSegments).limit == budget);
    return timeline->budget()->usage(kPool).limit;
  };
  CHECK(limit_of(kMiB) == 1024 * kMiB);
  CHECK(limit_of(5000 * kMiB) == 5000 * kMiB);
}

TEST_CASE("every allocation that grows with the scene or the image is charged") {
  const auto huge = make_timeline(2000, kHuge), tiny = make_timeline(300'000, kTiny);
  for (const auto& [timeline, view] :
       {std::pair{huge.get(), make_view(640, 480)}, std::pair{tiny.get(), make_view(640, 480)},
        std::pair{tiny.get(), make_view(2048, 2048)}}) {
    const auto renderer = cpu_renderer();
    draw(*renderer, *timeline, {make_view(16, 16)});  // starts threads
    for (const std::size_t views : {1, 3}) {
      const std::uint64_t before = timeline->budget()->usage(kPool).used;
      const Drawn drawn = draw(*renderer, *timeline, std::vector<View>(views, view));
      REQUIRE(drawn.status.ok());
      INFO(views << " views of " << view.camera.width << " pixels, heap " << drawn.heap << ", peak "
                 << timeline->budget()->usage(kPool).peak << ", before " << before);
      CHECK(drawn.heap + before <= timeline->budget()->usage(kPool).peak + kUncharged);
    }
  }
  CHECK(huge->budget()->usage(kPool).used == 0);
  CHECK(tiny->budget()->usage(kPool).used == 0);
}

TEST_CASE("a frame beyond the limit fails within it, and the next one is drawn") {
  const auto [count, log_scale, what] =
      GENERATE(std::tuple{2000, kHuge, "tile lists"}, std::tuple{300'000, kTiny, "splats"});
  const auto timeline = make_timeline(static_cast<std::size_t>(count), log_scale);
  const auto renderer = cpu_renderer();
  const View large = make_view(640, 480), small = make_view(64, 48, 30.0f);
  const std::vector<float> expected = colour_of(*cpu_renderer(), *timeline, small);
  // Whole MiB, so that the limit in the message is exact.
  constexpr std::uint64_t kLimit = 20 * kMiB;
  timeline->budget()->set_limit(kPool, kLimit);
  for (int repeat = 0; repeat < 2; ++repeat) {
    const Drawn drawn = draw(*renderer, *timeline, {large});
    INFO(drawn.status.message());
    CHECK(drawn.status.code() == StatusCode::kLimit);
    CHECK(drawn.status.message().find(what) != std::string::npos);
    CHECK(drawn.status.message().find("limit 20 MiB") != std::string::npos);
    CHECK(timeline->budget()->usage(kPool).peak <= kLimit);
    CHECK(timeline->budget()->usage(kPool).peak > kLimit / 2);
    CHECK(drawn.heap <= kLimit + kUncharged);
    CHECK(timeline->budget()->usage(kPool).used == 0);
    CHECK(colour_of(*renderer, *timeline, small) == expected);
  }
}

TEST_CASE("memory that earlier frames left is freed before a frame is refused") {
  const auto huge = make_timeline(1000, kHuge), tiny = make_timeline(100'000, kTiny);
  const std::vector<View> view{make_view(640, 480)};
  const auto peak_of = [&](Timeline& timeline) {
    REQUIRE(cpu_renderer()->draw(timeline, kTime, view, nullptr).ok());
    return timeline.budget()->usage(kPool).peak;
  };
  const std::uint64_t limit = std::max(peak_of(*huge), peak_of(*tiny));
  const auto renderer = cpu_renderer();
  for (const auto& timeline : {huge.get(), tiny.get(), huge.get(), tiny.get()}) {
    timeline->budget()->set_limit(kPool, limit);
    const Drawn drawn = draw(*renderer, *timeline, view);
    INFO(drawn.status.message());
    CHECK(drawn.status.ok());
  }
}

TEST_CASE("a renderer moves its memory to the budget of another timeline") {
  const auto one = make_timeline(100'000, kTiny), other = make_timeline(10, kTiny);
  const auto renderer = cpu_renderer();
  const View view = make_view(320, 240);
  REQUIRE(renderer->draw(*one, kTime, {view}, nullptr).ok());
  const std::uint64_t used = one->budget()->usage(kPool).used;
  CHECK(used > 5 * kMiB);
  SECTION("which has capacity for it") {
    REQUIRE(renderer->draw(*other, kTime, {view}, nullptr).ok());
    CHECK(other->budget()->usage(kPool).used >= used);
  }
  SECTION("which has not") {
    other->budget()->set_limit(kPool, 4 * kMiB);
    REQUIRE(renderer->draw(*other, kTime, {view}, nullptr).ok());
    CHECK(other->budget()->usage(kPool).used <= 4 * kMiB);
  }
  CHECK(one->budget()->usage(kPool).used == 0);
}

TEST_CASE("at half resolution, a list of any length takes little more memory") {
  const auto timeline = make_timeline(400'000, kTiny);
  View view = make_view(32, 32, 0.1f);  // all primitives in a tile
  view.fovea = Fovea{{-1e6f, -1e6f}, 0.0f};
  const auto renderer = cpu_renderer();
  REQUIRE(draw(*renderer, *timeline, {view}).status.ok());
  // The buffers have their final size: the rest is what blending takes.
  const Drawn again = draw(*renderer, *timeline, {view});
  REQUIRE(again.status.ok());
  CHECK(again.heap <= kUncharged);
}

}  // namespace stgs::player
