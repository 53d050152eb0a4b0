// SPDX-License-Identifier: Apache-2.0
// Long captures as windows of time: planned, trained separately and merged.
#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "catch.h"
#include "fixtures/played_psnr.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/pack.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/windows.h"
#include "train/initial_state.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace {

constexpr int kFrames = 24;

Scene trained(const PreparedCapture& capture, int iterations) {
  Result<Scene> scene = train(capture, test::short_run(iterations), nullptr, nullptr, nullptr);
  INFO(scene.status().message());
  REQUIRE(scene.ok());
  return std::move(*scene);
}

struct Start {
  std::set<std::array<float, 3>> static_points, dynamic_points;  // initial positions
  std::array<float, 3> background{};
};

Start start_of(const PreparedCapture& complete, const FrameSpan& span, std::uint64_t seed) {
  HyperParameters parameters;
  parameters.max_primitives = 200;  // 120 initially, of which at most 60 are dynamic
  const Result<PreparedCapture> window = extract_window(complete, span);
  REQUIRE(window.ok());
  const Result<TrainState> state = initial_state(*window, parameters, {}, seed);
  INFO(state.status().message());
  REQUIRE(state.ok());
  Start start;
  start.background = {state->background.x, state->background.y, state->background.z};
  for (std::size_t i = 0; i < state->size(); ++i) {
    const float* p = &state->set.position[3 * i];
    const bool moves = state->log_sigma[i] < std::log(2 * parameters.sigma_dynamic);
    (moves ? start.dynamic_points : start.static_points).insert({p[0], p[1], p[2]});
  }
  CHECK(start.static_points.size() + start.dynamic_points.size() == 120);
  return start;
}

// An empty scene of one window of a capture.
WindowScene window_scene(const std::string& name, std::uint32_t first, std::uint32_t frames) {
  WindowScene window{name, {}};
  window.scene.metadata.frames = frames;
  window.scene.metadata.window = CaptureWindow{first, 100, 7, 8};
  return window;
}

}  // namespace

TEST_CASE("windows cover the capture with the requested overlap") {
  const auto spans = [](int frames, int length, int overlap) {
    const auto planned = plan_windows(frames, length, overlap);
    REQUIRE(planned.ok());
    return *planned;
  };
  using Spans = std::vector<FrameSpan>;
  CHECK(spans(10, 10, 3) == Spans{{0, 10}});
  CHECK(spans(10, 20, 3) == Spans{{0, 10}});
  CHECK(spans(24, 12, 0) == Spans{{0, 12}, {12, 24}});
  CHECK(spans(28, 12, 4) == Spans{{0, 12}, {8, 20}, {16, 28}});
  CHECK(spans(24, 12, 4) == Spans{{0, 12}, {8, 20}, {12, 24}});  // the last has full length
  CHECK(spans(4, 2, 1) == Spans{{0, 2}, {1, 3}, {2, 4}});
  for (const auto& [length, overlap] : {std::pair{0, 0}, {5, 5}, {5, 6}, {5, -1}}) {
    CHECK(plan_windows(20, length, overlap).status().code() == StatusCode::kUsage);
  }
}

TEST_CASE("a window takes its frames, points and times from the capture") {
  const SyntheticCapture synthetic(4, 8);
  const PreparedCapture& complete = synthetic.capture;
  const Result<PreparedCapture> window = extract_window(complete, {3, 7});
  REQUIRE(window.ok());
  CHECK(window->frames == 4);
  CHECK(window->frame_path(complete.cameras[0], 1) == complete.frame_path(complete.cameras[0], 4));
  CHECK(window->mask_path(complete.cameras[0], 1) == complete.mask_path(complete.cameras[0], 4));
  TrainSettings settings = test::short_run(1);
  settings.max_primitives = 5000;  // keeps every initial point
  settings.overrides = {{"compact_share", "0"}};
  const Result<Scene> start = train(*window, settings, nullptr, nullptr, nullptr);
  REQUIRE(start.ok());
  CHECK(start->metadata.frames == 4);
  REQUIRE(start->metadata.window);
  CHECK(start->metadata.window->first_frame == 3);
  CHECK(start->metadata.window->capture_frames == 8);
  CHECK(start->gaussians.size() == 220 + 4 * 12);  // static, and dynamic of four frames
  const auto [first, last] =
      std::minmax_element(start->gaussians.time.begin(), start->gaussians.time.end());
  CHECK(*first == Approx(0).margin(0.1));
  CHECK(*last == Approx(3).margin(0.1));

  CHECK(capture_for_scene(complete, start->metadata, "x")->first_frame == complete.first_frame + 3);
  PreparedCapture other = complete;
  other.cameras[1].fx += 1;
  CHECK(capture_for_scene(other, start->metadata, "x").status().code() == StatusCode::kUsage);
  for (const FrameSpan span : {FrameSpan{-1, 4}, {4, 4}, {5, 4}, {0, 9}}) {
    CHECK(extract_window(complete, span).status().code() == StatusCode::kUsage);
  }
}

TEST_CASE("equivalent training settings have the same id, however they are written") {
  TrainSettings settings;
  settings.preset = "fast";
  settings.backend = "cpu";
  const auto id_of = [](const TrainSettings& of) {
    const Result<std::uint64_t> id = settings_id(of);
    INFO(id.status().message());
    REQUIRE(id.ok());
    return *id;
  };
  const std::uint64_t id = id_of(settings);
  TrainSettings other = settings;
  other.iterations = 3600;  // the default of fast
  other.overrides = {{"coarse_until", ".250"}};
  other.seed = 9;
  CHECK(id_of(other) == id);
  other.overrides = {{"coarse_until", "0.26"}};
  CHECK(id_of(other) != id);
  other = settings;
  other.max_seconds = 60;
  CHECK(id_of(other) != id);
  other = settings;
  other.ablate = "lifespan,modulation";
  const std::uint64_t ablated = id_of(other);
  CHECK(ablated != id);
  other.ablate = "modulation,lifespan";
  CHECK(id_of(other) == ablated);
  other.preset = "slow";
  CHECK(settings_id(other).status().code() == StatusCode::kUsage);
  other = settings;
  other.perceptual_weights = "/nowhere/vgg16.safetensors";
  CHECK(settings_id(other).status().code() == StatusCode::kIo);
}

TEST_CASE("windows share static points and background, independent of motion and seed") {
  const SyntheticCapture synthetic(4, kFrames);
  const PreparedCapture& complete = synthetic.capture;
  const Start first = start_of(complete, {0, 12}, 1), second = start_of(complete, {10, 22}, 2);
  CHECK(first.dynamic_points.size() == 60);
  CHECK(second.static_points == first.static_points);
  CHECK(second.background == first.background);
  CHECK(start_of(complete, {0, 12}, 2).dynamic_points != first.dynamic_points);
  // With few dynamic points, more static points are selected.
  const Start short_window = start_of(complete, {8, 11}, 3);
  CHECK(short_window.dynamic_points.size() == 36);
  CHECK(std::includes(short_window.static_points.begin(), short_window.static_points.end(),
                      first.static_points.begin(), first.static_points.end()));
  CHECK(short_window.background == first.background);
  for (std::uint64_t seed = 4; seed < 10; ++seed) {
    CHECK(start_of(complete, {0, kFrames}, seed).background == first.background);
  }
}

TEST_CASE("merged windows match a single training in quality, also at window boundaries") {
  const SyntheticCapture synthetic(4, kFrames);
  const PreparedCapture& complete = synthetic.capture;
  const std::string folder = complete.folder + "/";
  const auto spans = plan_windows(kFrames, 12, 4);
  REQUIRE(spans.ok());
  WriteSettings lossless;
  std::vector<std::string> paths;
  std::vector<std::vector<double>> separate;  // PSNR of each window by frame
  const Scene single_window = trained(complete, 600);
  for (const FrameSpan& span : *spans) {
    const Result<PreparedCapture> window = extract_window(complete, span);
    REQUIRE(window.ok());
    paths.push_back(folder + std::to_string(span.begin) + ".stgs");
    const Scene scene = trained(*window, 600);
    CHECK(std::equal(scene.metadata.background, scene.metadata.background + 3,
                     single_window.metadata.background));
    REQUIRE(write_scene(paths.back(), scene, lossless).ok());
    separate.push_back(test::psnr_by_frame(paths.back(), *window));
  }
  REQUIRE(write_scene(folder + "one.stgs", single_window, lossless).ok());
  const std::vector<double> single = test::psnr_by_frame(folder + "one.stgs", complete);

  std::rotate(paths.begin(), paths.begin() + 1, paths.end());  // input order does not matter
  PackReport report;
  PackSettings settings;
  settings.quality = 100;
  const Status packed = pack(paths, folder + "merged.stgs", settings, &report);
  INFO(packed.message());
  REQUIRE(packed.ok());
  REQUIRE(report.parts.size() == 3);
  const double boundaries[] = {0, 9.5, 15.5, kFrames};
  const std::vector<double> merged = test::psnr_by_frame(folder + "merged.stgs", complete);
  for (std::size_t p = 0; p < 3; ++p) {
    CHECK(report.parts[p].input == folder + std::to_string((*spans)[p].begin) + ".stgs");
    CHECK(report.parts[p].begin_ticks == boundaries[p]);
    CHECK(report.parts[p].end_ticks == boundaries[p + 1]);
    // Each frame equals the window's within packing error: overlapping primitives are shown once.
    for (int f = static_cast<int>(std::ceil(boundaries[p])); f < boundaries[p + 1]; ++f) {
      const auto own = static_cast<std::size_t>(f - (*spans)[p].begin);
      INFO("frame " << f << " of window " << p);
      CHECK(merged[static_cast<std::size_t>(f)] == Approx(separate[p][own]).margin(0.1));
    }
  }
  double worst = 100;
  for (const std::size_t f : {9, 10, 15, 16}) worst = std::min(worst, merged[f]);
  CAPTURE(test::mean_of(single), test::mean_of(merged), worst);
  CHECK(test::mean_of(merged) > test::mean_of(single));
  CHECK(worst > test::mean_of(merged) - 1.0);
}

TEST_CASE("windows that do not form one capture are not merged") {
  const auto rejection = [](std::vector<WindowScene> windows) {
    const Status status = merge_windows(std::move(windows)).status();
    CHECK(status.code() == StatusCode::kUsage);
    return status.message();
  };
  const WindowScene a = window_scene("a", 0, 60), b = window_scene("b", 50, 50);
  REQUIRE(merge_windows({b, a}).ok());
  CHECK(merge_windows({a, b})->parts == std::vector<ScenePart>{{0, 54.5, 0}, {54.5, 100, 0}});
  CHECK(merge_windows({window_scene("a", 0, 50), b})->parts[0].end_ticks == 49.5);
  CHECK(rejection({a}).find("two windows") != std::string::npos);
  CHECK(rejection({a, {"c", {}}}).find("c: not a window") == 0);
  CHECK(rejection({window_scene("a", 0, 40), b}) ==
        "frames 40:50 are missing between a and b; add their window");
  CHECK(rejection({window_scene("a", 5, 60), b}) ==
        "frames 0:5 are missing before a; add their window");
  CHECK(rejection({a, window_scene("b", 50, 45)}) ==
        "frames 95:100 are missing after b; add their window");
  CHECK(rejection({a, b, window_scene("c", 60, 40)}).find("one window contains the other") !=
        std::string::npos);
  CHECK(rejection({a, a, b}).find("one window contains the other") != std::string::npos);
  WindowScene other = b;
  other.scene.metadata.window->capture = 9;
  CHECK(rejection({a, other}) ==
        "a and b: windows of different captures; merge windows of one capture");
  other = b;
  other.scene.metadata.window->training = 9;
  CHECK(rejection({a, other}).find("different settings") != std::string::npos);
  other = b;
  other.scene.gaussians.sh_degree = 2;
  CHECK(rejection({a, other}).find("different SH degrees (0 and 2)") != std::string::npos);
  other = b;
  other.scene.metadata.background[2] = 9 / 255.0f;
  CHECK(rejection({a, other}).find("different backgrounds (0 0 0 and 0 0 9 of 255)") !=
        std::string::npos);
}

TEST_CASE("backgrounds that differ by rounding are replaced by the first window's, and logged") {
  WindowScene a = window_scene("a", 0, 60), b = window_scene("b", 50, 50);
  a.scene.metadata.background[2] = 100 / 255.0f;
  b.scene.metadata.background[2] = 101 / 255.0f;
  std::string logged;
  const LogSink log = [&logged](int, const std::string& line) { logged += line; };
  const Result<Scene> merged = merge_windows({b, a}, log);
  REQUIRE(merged.ok());
  CHECK(merged->metadata.background[2] == 100 / 255.0f);
  CHECK(logged == "the windows' backgrounds differ by up to 1 of 255; using 0 0 100 of a");
}
