// SPDX-License-Identifier: Apache-2.0
#include <catch2/catch.hpp>
#include <filesystem>

#include "stgs/encoder/train.h"
#include "synthetic_capture.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::SyntheticCapture;

namespace {

TrainSettings short_run(int iterations) {
  TrainSettings settings;
  settings.preset = "fast";
  settings.iterations = iterations;
  settings.max_primitives = 600;
  settings.overrides = {{"densify_interval", "20"}, {"sh_degree", "1"}};
  return settings;
}

bool same(const Gaussians4D& a, const Gaussians4D& b) {
  return a.position == b.position && a.log_scale == b.log_scale && a.rotation == b.rotation &&
         a.opacity_logit == b.opacity_logit && a.sh == b.sh && a.time == b.time &&
         a.velocity == b.velocity && a.sigma == b.sigma && a.radius == b.radius;
}

Result<Scene> run(const SyntheticCapture& synthetic, const TrainSettings& settings,
                  const ProgressSink& progress = nullptr) {
  return train(synthetic.capture, settings, progress, nullptr, nullptr);
}

}  // namespace

TEST_CASE("frames from disk give the same scene as frames in memory") {
  const SyntheticCapture synthetic("train_frames");
  TrainSettings settings = short_run(90);
  TrainReport report;
  const Result<Scene> resident = train(synthetic.capture, settings, nullptr, nullptr, &report);
  REQUIRE(resident.ok());
  CHECK(report.frames.resident);
  CHECK(report.frames.decoded == 18);  // three cameras, six frames
  CHECK(report.frames.waits == 0);
  // Three full-size pictures, and less than one.
  for (const std::uint64_t budget : {3 * 3 * 96 * 64, 1000}) {
    settings.frame_memory = budget;
    const Result<Scene> streamed = train(synthetic.capture, settings, nullptr, nullptr, &report);
    REQUIRE(streamed.ok());
    CHECK(same(resident->gaussians, streamed->gaussians));
    CHECK_FALSE(report.frames.resident);
    CHECK(report.frames.budget == budget);
    CHECK(report.frames.peak <= budget);
    CHECK(report.frames.decoded > 18);
  }
}

TEST_CASE(
    "a frame that breaks in the middle of a training is named, and what was trained is kept") {
  const SyntheticCapture synthetic("train_broken_frame");
  TrainSettings settings = short_run(90);
  const Result<Scene> whole = run(synthetic, settings);
  settings.frame_memory = 2 * 3 * 96 * 64;
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  const std::string frame = synthetic.capture.frame_path(synthetic.capture.cameras[2], 4);
  const std::string aside = synthetic.capture.folder + "/aside.png";
  const Result<Scene> broken = run(synthetic, settings, [&](const Progress& progress) {
    if (progress.stage == "load") std::filesystem::rename(frame, aside);
    return true;
  });
  REQUIRE_FALSE(broken.ok());
  CHECK(broken.status().code() == StatusCode::kIo);
  CHECK(broken.status().message().find(frame) != std::string::npos);
  REQUIRE(std::filesystem::exists(settings.checkpoint));
  std::filesystem::rename(aside, frame);
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(whole->gaussians, resumed->gaussians));
}
