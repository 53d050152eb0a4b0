// SPDX-License-Identifier: Apache-2.0
// Rigs without synchronisation: the times of images, stated in the capture or refined in training.
#include <cmath>
#include <string>
#include <vector>

#include "catch.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/train.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::run;
using stgs::test::short_run;
using stgs::test::SyntheticCapture;

namespace {

// PSNR in dB of the moving blob as the held-out camera sees it, over all frames.
double moving_psnr(const SyntheticCapture& synthetic, const Scene& scene) {
  const Camera& camera = synthetic.capture.cameras.front();
  const math::PinholeCamera pinhole = camera.pinhole(synthetic.capture.near_plane);
  SplatFrame frame;
  RasterOutput rendered, ground_truth;
  RasterSettings settings;
  const float* background = scene.metadata.background;
  settings.background = {background[0], background[1], background[2]};
  settings.kernel = scene.metadata.kernel;
  double squares = 0, pixels = 0;
  for (int f = 0; f < synthetic.capture.frames; ++f) {
    const auto t = static_cast<float>(f);
    render(scene.gaussians, t, pinhole, settings, frame, rendered);
    render(synthetic.ground_truth, t, pinhole, {}, frame, ground_truth);
    const Image alpha = test::moving_alpha(synthetic, camera, f);
    for (std::size_t i = 0; i < alpha.data.size(); ++i) {
      pixels += alpha.data[i];
      for (int c = 0; c < 3; ++c) {
        const double d = ground_truth.colour.plane(c)[i] - rendered.colour.plane(c)[i];
        squares += alpha.data[i] * d * d / 3;
      }
    }
  }
  return -10 * std::log10(squares / pixels);
}

}  // namespace

TEST_CASE("a frame of a camera is its image nearest in time, with the time of that image") {
  PreparedCapture capture;
  capture.time_base = {1, 50};
  capture.first_frame = 10;
  Camera camera;
  CHECK(capture.own_frame(camera, 3) == 13);
  CHECK(capture.time_of(camera, 3) == 3);
  camera.time_shift = 0.25;
  CHECK(capture.time_of(camera, 3) == 3.25);
  camera.time_shift = 0;

  camera.time_offset = 2.3 / 50;
  CHECK(capture.own_frame(camera, 3) == 11);
  CHECK(capture.time_of(camera, 3) == Approx(3.3));
  camera.time_offset = -2.3 / 50;
  CHECK(capture.own_frame(camera, 3) == 15);
  CHECK(capture.time_of(camera, 3) == Approx(2.7));
  for (int frame = 0; frame < 100; ++frame) {  // of two that are equally near, always the later one
    camera.time_offset = 0.5 / 50;
    CHECK(capture.own_frame(camera, frame) == frame + 10);
    CHECK(capture.time_of(camera, frame) == Approx(frame + 0.5));
  }

  camera.time_offset = 0;
  camera.fps = 25;  // each image twice
  CHECK(capture.own_frame(camera, 0) == 5);
  CHECK(capture.own_frame(camera, 1) == 6);
  CHECK(capture.own_frame(camera, 2) == 6);
  CHECK(capture.time_of(camera, 0) == Approx(0).margin(1e-9));
  CHECK(capture.time_of(camera, 1) == Approx(2));
  CHECK(capture.time_of(camera, 2) == Approx(2));
  camera.fps = 60;
  CHECK(capture.own_frame(camera, 4) == 17);  // at 0.2833 s, not 16 at 0.2667 s
  CHECK(capture.time_of(camera, 4) == Approx(17 * 50.0 / 60 - 10));

  capture.time_base = {0xffffffff, 1};
  capture.first_frame = 1'000'000'000;
  camera.fps = 1e5;
  CHECK(capture.own_frame(camera, 0) == std::int64_t{1'000'000'000'000'000});
  CHECK(std::isfinite(capture.time_of(camera, 0)));
}

TEST_CASE("refinement finds the times of unsynchronised cameras and regains what they cost") {
  const std::vector<double> late = {0, 0.5, -0.5, 0, 0.3, -0.2};
  SyntheticCapture synthetic(static_cast<int>(late.size()), 6, late);
  TrainSettings settings = short_run(1200);
  settings.max_primitives = 1000;
  settings.overrides.insert(settings.overrides.end(), {{"initial_opacity_dynamic", "0.5"},
                                                       {"initial_scale_dynamic", "0.8"},
                                                       {"compact_share", "0"}});
  const Result<Scene> wrong = run(synthetic, settings);
  settings.refine_timing = true;
  TrainReport report;
  std::string logged;
  const auto log = [&](int level, const std::string& line) {
    if (level == 1) logged += line + "\n";
  };
  const Result<Scene> refined = train(synthetic.capture, settings, nullptr, log, &report);
  settings.refine_timing = false;
  for (std::size_t i = 0; i < late.size(); ++i) {
    Camera& camera = synthetic.capture.cameras[i];
    camera.time_offset = synthetic.capture.time_base.seconds(late[i]);
  }
  const Result<Scene> exact = run(synthetic, settings);
  REQUIRE(wrong.ok());
  REQUIRE(refined.ok());
  REQUIRE(exact.ok());

  REQUIRE(report.cameras.size() == 5);
  for (std::size_t i = 0; i < report.cameras.size(); ++i) {
    const RefinedCamera& found = report.cameras[i];
    CAPTURE(found.camera.name, found.time_shift);
    CHECK(found.time_shift == Approx(late[i + 1]).margin(0.1));
    CHECK(found.time_offset == Approx(synthetic.capture.time_base.seconds(found.time_shift)));
    CHECK(found.pixels == 0);  // the poses remain
    CHECK((logged.find(fmt::format("camera '{}'", found.camera.name)) != std::string::npos) ==
          (std::abs(late[i + 1]) > 0.25));
  }
  const double without = moving_psnr(synthetic, *wrong), with = moving_psnr(synthetic, *refined);
  const double best = moving_psnr(synthetic, *exact);
  CAPTURE(without, with, best);
  CHECK(best > without + 2);
  CHECK(with > without + 0.9 * (best - without));
}
