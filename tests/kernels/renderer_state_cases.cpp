// SPDX-License-Identifier: Apache-2.0
// A device's renderer from frame to frame: determinism, capacity, residency, damage and errors.
#include <chrono>
#include <thread>

#include "renderer_cases.h"
#include "stgs/player/player.h"

using namespace stgs;
using namespace stgs::player;
using namespace stgs::testing;

TEST_CASE("frames do not depend on the run, the code path or the frames before them") {
  const auto one = device_renderer();
  const auto variant = device_renderer({.variant = true});
  const auto timeline = make_timeline(random_scene(6000, 2, kFrames, 12));
  const auto other = make_timeline(random_scene(500, 0, kFrames, 13));
  const View view = make_view(160, 90);
  std::vector<Frame> first;
  for (int k = 0; k < 6; ++k) first.push_back(render_views(*one, *timeline, 0.3 * k, {view})[0]);
  render_views(*one, *other, 0.1, {make_view(31, 200)});
  for (int k = 5; k >= 0; --k) {
    CHECK(identical(render_views(*one, *timeline, 0.3 * k, {view})[0],
                    first[static_cast<std::size_t>(k)]));
    CHECK(identical(render_views(*variant, *timeline, 0.3 * k, {view})[0],
                    first[static_cast<std::size_t>(k)]));
  }
}

TEST_CASE("a frame with more tile instances than allocated is rendered again with more memory") {
  const auto ample = device_renderer();
  const auto tight = device_renderer({.instances = 100});
  const auto timeline = make_timeline(static_scene(2000));
  for (const int width : {100, 333, 50}) {
    const std::vector<View> views(width == 333 ? 3 : 1, make_view(width, 150));
    const std::vector<Frame> a = render_views(*ample, *timeline, 1.0, views);
    const std::vector<Frame> b = render_views(*tight, *timeline, 1.0, views);
    for (std::size_t i = 0; i < views.size(); ++i) CHECK(identical(a[i], b[i]));
  }
}

TEST_CASE("a view with more tile instances than a frame can list fails, as on the CPU", "[large]") {
  Scene scene = static_scene(1100);
  std::fill(scene.gaussians.log_scale.begin(), scene.gaussians.log_scale.end(), 6.0f);
  std::fill(scene.gaussians.opacity_logit.begin(), scene.gaussians.opacity_logit.end(), 5.0f);
  const auto timeline = make_timeline(scene);
  const auto device = device_renderer();
  View view = make_view(4096, 4096);
  view.camera.near_plane = 0.01f;
  const Status status = device->draw(*timeline, 1.5, {view}, nullptr);
  INFO(status.message());
  CHECK(status.code() == StatusCode::kRuntime);
  CHECK(status.message().find("the limit of 2^2") != std::string::npos);
  render_views(*device, *timeline, 1.5, {make_view(64, 64)});
}

TEST_CASE("segments are loaded and evicted within the memory budget of the timeline") {
  const Scene scene = random_scene(6000, 1, kFrames, 21);
  const auto ample = make_timeline(scene);
  const auto tight = make_timeline(scene, 0.3, 700'000);
  const auto one = device_renderer(), other = device_renderer();
  const View view = make_view(90, 60);
  std::size_t max_stored = 0;
  for (std::uint32_t k = 0, i = 11; k < kFrames; ++k, i = (i + 37) % kFrames) {
    RenderStats stats;
    const std::vector<Frame> a = render_views(*one, *ample, i / 30.0, {view});
    CHECK(identical(a[0], render_views(*other, *tight, i / 30.0, {view}, &stats)[0]));
    max_stored = std::max(max_stored, stats.stored);
  }
  CHECK(max_stored < scene.gaussians.size());
  const auto too_small = make_timeline(scene, 0.3, 1000);
  const Status status = one->draw(*too_small, 1.0, {view}, nullptr);
  CHECK(status.code() == StatusCode::kLimit);
  CHECK(status.message().find("budget") != std::string::npos);
}

TEST_CASE("damaged segments are skipped or rejected, as on the CPU") {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.chunk_seconds = 0.3;
  auto bytes = encode_scene(random_scene(4000, 2, kFrames, 51), settings);
  check(bytes.status());
  const auto intact = SceneReader::open(memory_source(*bytes));
  check(intact.status());
  const auto& segments = (*intact)->segments();
  REQUIRE(segments.size() > 6);
  for (std::size_t k = 0; k < segments.size(); k += 3) {
    const SegmentInfo& s = segments[k];
    const std::uint64_t offset = k % 2 == 0 && s.sh_bytes > 0
                                     ? s.sh_offset + s.sh_bytes / 2
                                     : s.offset + (s.bytes - s.sh_bytes) / 2;
    (*bytes)[offset] ^= 0x55;
  }
  for (const DamagePolicy policy : {DamagePolicy::kSkip, DamagePolicy::kReject}) {
    std::vector<Frame> frames[2];
    Status status[2];
    std::size_t damage[2];
    for (int k = 0; k < 2; ++k) {
      auto reader = SceneReader::open(memory_source(*bytes));
      check(reader.status());
      const auto timeline =
          Timeline::from_reader(std::move(*reader), "the scene", kDefaultMemoryBudget, policy);
      const auto renderer = k == 0 ? cpu_renderer() : device_renderer();
      status[k] = renderer->render(*timeline, 1.0, {make_view(120, 80)}, frames[k], nullptr);
      damage[k] = timeline->segment_damage().size();
    }
    CHECK(status[0].code() == status[1].code());
    CHECK(damage[0] == damage[1]);
    CHECK((damage[0] > 0) == (policy == DamagePolicy::kSkip));
    if (status[0].ok() && status[1].ok()) {
      const FrameDifference d = difference(frames[0][0], frames[1][0]);
      INFO(d.text());
      CHECK(d.agrees());
    }
  }
}

TEST_CASE("a partly loaded scene renders its available layers") {
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
    render_views(*device, timeline, 1.0, {make_view(60, 40)});
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  check_matches_cpu(timeline, 1.0, {make_view(160, 90)}, *device);
}

TEST_CASE("profile() returns the time and bytes of each step, if the backend supports it") {
  const auto device = device_renderer();
  CHECK(!device->profile().ok());
  const auto timeline = make_timeline(random_scene(5000, 2, kFrames, 16));
  const std::vector<View> views = {make_view(150, 90), make_view(64, 64)};
  const std::vector<Frame> before = render_views(*device, *timeline, 1.2, views);
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
  if (device->name() != "vulkan") {  // the Vulkan backend counts no operations
    CHECK(profile->operations_per_second > 1e9);
    // Each pixel of a covered frame takes at least one evaluation.
    CHECK(profile->steps.back().operations > 150 * 90);
  }
  std::vector<Frame> after;
  check(device->read(after));
  for (std::size_t i = 0; i < views.size(); ++i) CHECK(identical(before[i], after[i]));
}

TEST_CASE("invalid arguments are rejected, and the renderer stays usable") {
  const auto device = device_renderer();
  const auto timeline = make_timeline(random_scene(100, 0, kFrames, 2));
  const View view = make_view(32, 32);
  CHECK(device->draw(*timeline, 0, {}, nullptr).code() == StatusCode::kUsage);
  CHECK(device->draw(*timeline, 0, {view, view, view, view, view}, nullptr).code() ==
        StatusCode::kUsage);
  CHECK(device->draw(*timeline, NAN, {view}, nullptr).code() == StatusCode::kUsage);
  View foveated = view;
  foveated.fovea = Fovea{{16, 16}, -1};
  CHECK(device->draw(*timeline, 0, {foveated}, nullptr).code() == StatusCode::kUsage);
  foveated.fovea = Fovea{{NAN, 16}, 1};
  CHECK(device->draw(*timeline, 0, {foveated}, nullptr).code() == StatusCode::kUsage);
  std::vector<Frame> frames(3);
  check(device->read(frames));
  CHECK(frames.empty());
  render_views(*device, *timeline, 0, {view});
}

TEST_CASE("a frame beyond the memory limit of the timeline fails, and the next one is drawn") {
  constexpr std::uint64_t kLimit = std::uint64_t{48} << 20;
  Scene scene = static_scene(2000);
  const auto timeline = make_timeline(scene);
  std::fill(scene.gaussians.log_scale.begin(), scene.gaussians.log_scale.end(), 6.0f);
  const auto huge = make_timeline(scene);  // 1200 tiles for each primitive
  const View view = make_view(640, 480);
  const Frame expected = render_views(*device_renderer(), *timeline, 1.0, {view})[0];
  const auto usage = [](const Timeline& of, Budget::Pool pool) { return of.budget()->usage(pool); };
  for (const auto& one : {timeline.get(), huge.get()}) {
    one->budget()->set_limit(Budget::Pool::kRenderer, kLimit);
  }
  auto renderer = device_renderer();
  for (int repeat = 0; repeat < 2; ++repeat) {
    const Status status = renderer->draw(*huge, 1.0, {view}, nullptr);
    INFO(status.message());
    CHECK(status.code() == StatusCode::kLimit);
    CHECK(status.message().find("limit 48 MiB") != std::string::npos);
    CHECK(usage(*huge, Budget::Pool::kRenderer).peak <= kLimit);
    CHECK(usage(*huge, Budget::Pool::kDeviceCopies).used > 0);
    CHECK(identical(render_views(*renderer, *timeline, 1.0, {view})[0], expected));
    CHECK(usage(*huge, Budget::Pool::kRenderer).used == 0);
    CHECK(usage(*huge, Budget::Pool::kDeviceCopies).used == 0);
    CHECK(usage(*timeline, Budget::Pool::kRenderer).peak <= kLimit);
    CHECK(usage(*timeline, Budget::Pool::kDeviceCopies).used > 0);
  }
  renderer.reset();
  CHECK(usage(*timeline, Budget::Pool::kRenderer).used == 0);
  CHECK(usage(*timeline, Budget::Pool::kDeviceCopies).used == 0);
}
