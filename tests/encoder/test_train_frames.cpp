// SPDX-License-Identifier: Apache-2.0
// Loading of training frames: resident or streamed from disk, cancellation, and read errors.
#include <filesystem>

#include "catch.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/train.h"
#include "stgs/format/parallel.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::run;
using stgs::test::same;
using stgs::test::short_run;
using stgs::test::SyntheticCapture;

TEST_CASE("frames from disk give the same scene as frames in memory") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(90);
  TrainReport report;
  const Result<Scene> resident = train(synthetic.capture, settings, nullptr, nullptr, &report);
  REQUIRE(resident.ok());
  CHECK(report.frames.resident);
  CHECK(report.frames.decoded == 18);  // three cameras, six frames
  CHECK(report.frames.waits == 0);
  // A budget of three full-size images, and of less than one.
  for (const std::uint64_t budget : {3 * 3 * 96 * 64, 1000}) {
    settings.frame_memory = budget;
    const Result<Scene> streamed = train(synthetic.capture, settings, nullptr, nullptr, &report);
    REQUIRE(streamed.ok());
    CHECK(same(resident->gaussians, streamed->gaussians));
    CHECK_FALSE(report.frames.resident);
    CHECK(report.frames.budget == budget);
    // In excess of the budget: the step's image, and images being decoded with their half sizes.
    const auto others = static_cast<std::uint64_t>(2 * concurrency() + 2);
    CHECK(report.frames.peak <= budget + others * 3 * 96 * 64);
    CHECK(report.frames.decoded > 18);
  }
}

TEST_CASE("training can be cancelled while its frames are loaded") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(20);
  for (const std::uint64_t memory : {0, 3 * 3 * 96 * 64}) {
    settings.frame_memory = memory;
    std::vector<std::string> stages;
    const Result<Scene> stopped = run(synthetic, settings, [&](const Progress& progress) {
      stages.push_back(progress.stage);
      return false;
    });
    CHECK(stopped.status().code() == StatusCode::kRuntime);
    CHECK(stages == std::vector<std::string>{"load"});
  }
}

TEST_CASE("a frame that becomes unreadable during training is named, and a checkpoint is written") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(90);
  const Result<Scene> uninterrupted = run(synthetic, settings);
  settings.frame_memory = 2 * 3 * 96 * 64;
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  const std::string frame = synthetic.capture.frame_path(synthetic.capture.cameras[2], 4);
  const std::string moved_frame = synthetic.capture.folder + "/aside.png";
  const Result<Scene> broken = run(synthetic, settings, [&](const Progress& progress) {
    if (progress.stage == "load") std::filesystem::rename(frame, moved_frame);
    return true;
  });
  REQUIRE_FALSE(broken.ok());
  CHECK(broken.status().code() == StatusCode::kIo);
  CHECK(broken.status().message().find(frame) != std::string::npos);
  CHECK(broken.status().message().find("--resume " + settings.checkpoint) != std::string::npos);
  REQUIRE(std::filesystem::exists(settings.checkpoint));
  std::filesystem::rename(moved_frame, frame);
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(uninterrupted->gaussians, resumed->gaussians));
}
