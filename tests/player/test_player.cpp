// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <set>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "fixtures/temporary_folder.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"
#include "stgs/player/renderer.h"

namespace stgs::player {
namespace {

constexpr std::uint32_t kFrames = 90;

std::vector<std::uint8_t> bytes_of(const Scene& scene) {
  WriteSettings settings;
  settings.chunk_seconds = 0.2;
  auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  return *bytes;
}

std::unique_ptr<Timeline> timeline_of(const Scene& scene,
                                      std::uint64_t budget = kDefaultMemoryBudget) {
  auto reader = SceneReader::open(memory_source(bytes_of(scene)));
  REQUIRE(reader.ok());
  return Timeline::from_reader(std::move(*reader), "the scene", budget);
}

math::PinholeCamera camera_of(float width, float height) {
  math::PinholeCamera camera{};
  camera.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  camera.fx = camera.fy = width;
  camera.cx = width / 2;
  camera.cy = height / 2;
  camera.width = width;
  camera.height = height;
  camera.near_plane = 0.1f;
  return camera;
}

// Fingerprints of the candidates in all active segments.
std::multiset<std::string> active_prints(const Timeline::Active& active) {
  std::multiset<std::string> out;
  for (const auto& segment : active.segments) {
    const auto prints = testing::fingerprints(segment.set->gather(*segment.candidates));
    out.insert(prints.begin(), prints.end());
  }
  return out;
}

float opacity_at(const Gaussians4D& set, std::size_t i, float ticks) {
  return math::opacity_of(set.opacity_logit[i]) *
         math::visibility(ticks - set.time[i], set.sigma[i], set.radius[i]);
}

TEST_CASE("a timeline returns exactly the primitives that are active at a time") {
  const Scene scene = testing::random_scene(3000, 1, kFrames, 3);
  const auto prints = testing::fingerprints(scene.gaussians);
  auto timeline = timeline_of(scene);
  for (const float ticks : {0.0f, 7.25f, 44.0f, 60.5f, 89.0f, 90.0f}) {
    auto active = timeline->at(scene.metadata.time_base.seconds(ticks));
    REQUIRE(active.ok());
    const auto found = active_prints(*active);
    std::size_t required = 0;
    for (std::size_t i = 0; i < prints.size(); ++i) {
      const float opacity = opacity_at(scene.gaussians, i, ticks);
      // Close to the threshold, rounding decides.
      if (opacity >= 1.001f * math::kAlphaThreshold) {
        ++required;
        REQUIRE(found.count(prints[i]) == 1);
      } else if (opacity < 0.99f * math::kAlphaThreshold) {
        REQUIRE(found.count(prints[i]) == 0);
      }
    }
    REQUIRE(required > 100);
    REQUIRE(required < scene.gaussians.size());
  }
}

// Renders a scene of one-second ticks at times between frames, relative to the tick `begin`.
std::vector<std::vector<float>> frames_from(std::uint32_t begin,
                                            std::unique_ptr<SceneReader> reader) {
  auto timeline = Timeline::from_reader(std::move(reader));
  auto renderer = make_renderer("cpu");
  REQUIRE(renderer.ok());
  std::vector<std::vector<float>> out;
  for (const double seconds : {0.0, 7.0 + 307.0 / 1024, 44.0 + 1.0 / 1024, 89.625}) {
    std::vector<Frame> frames;
    REQUIRE((*renderer)
                ->render(*timeline, begin + seconds, {{camera_of(160, 90)}}, frames, nullptr)
                .ok());
    out.push_back(frames[0].colour.data);
  }
  return out;
}

TEST_CASE("a part renders identically at any position of a long timeline") {
  constexpr std::uint32_t kLate = 1 << 20;  // single precision resolves 1/8 tick here
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    settings.chunk_seconds = 8;
    const auto reader_of = [&](std::uint32_t begin) {
      Scene scene = testing::random_scene(3000, 1, kFrames, 3);
      scene.metadata.time_base = {1, 1};
      scene.metadata.frames = begin + kFrames;
      scene.parts = {{double(begin), double(begin) + kFrames, scene.gaussians.size()}};
      auto bytes = encode_scene(scene, settings);
      INFO(bytes.status().message());
      REQUIRE(bytes.ok());
      const auto issues = validate_scene(*memory_source(*bytes));
      REQUIRE(issues.ok());
      CHECK(issues->empty());
      auto reader = SceneReader::open(memory_source(std::move(*bytes)));
      REQUIRE(reader.ok());
      return std::move(*reader);
    };
    const auto early = frames_from(0, reader_of(0)), late = frames_from(kLate, reader_of(kLate));
    CHECK(early[1] != early[2]);
    CHECK(early == late);
  }
}

TEST_CASE("a timeline stays within its memory budget and returns the same primitives") {
  const Scene scene = testing::random_scene(3000, 1, kFrames, 4);
  auto ample = timeline_of(scene);
  std::uint64_t needed = 0;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    auto fresh = timeline_of(scene);
    REQUIRE(fresh->at(i / 30.0).ok());
    needed = std::max(needed, fresh->memory_bytes());
    REQUIRE(ample->at(i / 30.0).ok());
  }
  REQUIRE(ample->memory_bytes() > needed);
  auto tight = timeline_of(scene, needed);
  for (std::uint32_t i = 0; i < kFrames; i += 3) {
    auto a = ample->at(i / 30.0);
    auto b = tight->at(i / 30.0);
    REQUIRE(b.ok());
    REQUIRE(tight->memory_bytes() <= needed);
    REQUIRE(active_prints(*a) == active_prints(*b));
  }
  auto insufficient = timeline_of(scene, needed / 4);
  const auto rejected = insufficient->at(1.0);
  REQUIRE(rejected.status().code() == StatusCode::kLimit);
  REQUIRE(rejected.status().message().find("budget") != std::string::npos);
}

TEST_CASE("the CPU renderer matches the rasteriser over all primitives") {
  const Scene scene = testing::random_scene(2000, 2, kFrames, 5);
  auto timeline = timeline_of(scene);
  auto renderer = make_renderer("cpu");
  REQUIRE(renderer.ok());
  const View view{camera_of(160, 90), {0.2f, 0.4f, 0.6f}};
  RasterSettings settings;
  settings.background = view.background;
  SplatFrame splats;
  RasterOutput expected;
  for (const double seconds : {0.0, 0.75, 2.9}) {
    std::vector<Frame> frames;
    RenderStats stats;
    REQUIRE((*renderer)->render(*timeline, seconds, {view}, frames, &stats).ok());
    const auto ticks = static_cast<float>(scene.metadata.time_base.ticks(seconds));
    render(scene.gaussians, ticks, view.camera, settings, splats, expected);
    REQUIRE(frames.size() == 1);
    REQUIRE(stats.splats == splats.splats.size());
    REQUIRE(stats.active < scene.gaussians.size());
    float max_difference = 0;
    for (std::size_t i = 0; i < expected.colour.data.size(); ++i) {
      max_difference =
          std::max(max_difference, std::abs(expected.colour.data[i] - frames[0].colour.data[i]));
    }
    for (std::size_t i = 0; i < expected.alpha.data.size(); ++i) {
      max_difference =
          std::max(max_difference, std::abs(expected.alpha.data[i] - frames[0].alpha.data[i]));
    }
    REQUIRE(max_difference < 1e-5f);
  }
}

TEST_CASE("random seeks and sequential playback render identical bits") {
  const Scene scene = testing::random_scene(2000, 1, kFrames, 6);
  auto played = timeline_of(scene), sought = timeline_of(scene);
  auto one = make_renderer("cpu"), other = make_renderer("cpu");
  const View view{camera_of(96, 64)};
  std::vector<std::vector<float>> in_order(kFrames);
  std::vector<Frame> frames;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    REQUIRE((*one)->render(*played, i / 30.0, {view}, frames, nullptr).ok());
    in_order[i] = frames[0].colour.data;
  }
  for (std::uint32_t k = 0, i = 11; k < kFrames; ++k, i = (i + 37) % kFrames) {
    REQUIRE((*other)->render(*sought, i / 30.0, {view}, frames, nullptr).ok());
    REQUIRE(frames[0].colour.data == in_order[i]);
  }
}

TEST_CASE("several views of one time equal the views rendered one by one") {
  const Scene scene = testing::random_scene(1000, 1, kFrames, 8);
  auto timeline = timeline_of(scene);
  auto renderer = make_renderer("cpu");
  const std::vector<View> views = {{camera_of(64, 48)}, {camera_of(96, 32), {1, 1, 1}}};
  std::vector<Frame> together, alone;
  REQUIRE((*renderer)->render(*timeline, 1.0, views, together, nullptr).ok());
  REQUIRE(together.size() == 2);
  for (std::size_t i = 0; i < views.size(); ++i) {
    REQUIRE((*renderer)->render(*timeline, 1.0, {views[i]}, alone, nullptr).ok());
    REQUIRE(alone[0].colour.data == together[i].colour.data);
    REQUIRE(alone[0].depth.data == together[i].depth.data);
  }
}

TEST_CASE("too many splats are an error that names the time and the file") {
  Scene scene = testing::random_scene(300, 0, kFrames, 10);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.log_scale.begin(), set.log_scale.end(), 6.0f);
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 5.0f);
  std::fill(set.radius.begin(), set.radius.end(), static_cast<float>(kFrames));
  const testing::TemporaryFolder folder;
  const std::string path = folder / "dense.stgs";
  REQUIRE(write_scene(path, scene, {}).ok());
  auto timeline = Timeline::open(path);
  REQUIRE(timeline.ok());
  auto renderer = make_renderer("cpu");
  std::vector<Frame> frames;
  const Status status =
      (*renderer)->render(**timeline, 1.5, {{camera_of(8192, 8192)}}, frames, nullptr);
  REQUIRE(status.code() == StatusCode::kRuntime);
  INFO(status.message());
  REQUIRE(status.message().find(path + ": cannot render 1.5 s: ") == 0);
  REQUIRE(status.message().find("2^26") != std::string::npos);
}

TEST_CASE("the renderer rejects invalid views, times and backends") {
  auto timeline = timeline_of(testing::random_scene(10, 0, kFrames, 9));
  auto renderer = make_renderer("cpu");
  std::vector<Frame> frames;
  const auto code = [&](const std::vector<View>& views, double seconds) {
    return (*renderer)->render(*timeline, seconds, views, frames, nullptr).code();
  };
  const View view{camera_of(32, 32)};
  REQUIRE(code({}, 0) == StatusCode::kUsage);
  REQUIRE(code({view, view, view, view, view}, 0) == StatusCode::kUsage);
  REQUIRE(code({{camera_of(0, 32)}}, 0) == StatusCode::kUsage);
  REQUIRE(code({view}, std::nan("")) == StatusCode::kUsage);
  REQUIRE(code({view}, 0) == StatusCode::kOk);
  const std::vector<std::string> built = renderer_backends();
  const bool has_cuda = std::find(built.begin(), built.end(), "cuda") != built.end();
  REQUIRE((make_renderer("cuda").status().code() == StatusCode::kNotBuilt) == !has_cuda);
  REQUIRE(make_renderer("auto").ok());
  const bool has_vulkan = std::find(built.begin(), built.end(), "vulkan") != built.end();
  if (!has_vulkan) REQUIRE(make_renderer("vulkan").status().code() == StatusCode::kNotBuilt);
  REQUIRE(make_renderer("abacus").status().code() == StatusCode::kUsage);
}

}  // namespace
}  // namespace stgs::player
