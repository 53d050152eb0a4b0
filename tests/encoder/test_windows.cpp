// SPDX-License-Identifier: Apache-2.0
// Windows of time of a longer capture, and the id of training settings.
#include <algorithm>

#include "catch.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/windows.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

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
  CHECK(start->gaussians.size() == 220 + 4 * 12);  // static, and dynamic of four frames
  const auto [first, last] =
      std::minmax_element(start->gaussians.time.begin(), start->gaussians.time.end());
  CHECK(*first == Approx(0).margin(0.1));
  CHECK(*last == Approx(3).margin(0.1));

  SceneMetadata scene = start->metadata;  // of a file that records its window
  scene.window = window->window;
  CHECK(capture_for_scene(complete, scene, "x")->first_frame == complete.first_frame + 3);
  PreparedCapture other = complete;
  other.cameras[1].fx += 1;
  CHECK(capture_for_scene(other, scene, "x").status().code() == StatusCode::kUsage);
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
