// SPDX-License-Identifier: Apache-2.0
// Checkpoints: interrupted runs resume to the same result, and unsuitable checkpoints are rejected.
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <stdexcept>
#include <utility>

#include "catch.h"
#include "fixtures/synthetic_capture.h"
#include "fixtures/train_run.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/training_log.h"
#include "train/camera_refinement.h"
#include "train/checkpoint.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::held_out_psnr;
using stgs::test::run;
using stgs::test::same;
using stgs::test::short_run;
using stgs::test::SyntheticCapture;

TEST_CASE("an interrupted and resumed run gives the same bits") {
  const SyntheticCapture synthetic;
  const std::string checkpoint = synthetic.capture.folder + "/train.ckpt";
  TrainSettings settings = short_run(120);
  settings.refine_cameras = settings.refine_timing = true;
  const Result<Scene> uninterrupted = run(synthetic, settings);
  REQUIRE(uninterrupted.ok());

  // Growth, the second stage and replacement follow iteration 35 of 120; only replacement and
  // compaction follow 70. At 98 primitives are being removed, at 110 values are rounded.
  settings.checkpoint_interval = GENERATE(35, 70, 98, 110);
  settings.checkpoint = checkpoint;
  const Result<Scene> stopped = run(synthetic, settings, [&](const Progress& progress) {
    return progress.stage != "train" || !std::filesystem::exists(checkpoint);
  });
  REQUIRE_FALSE(stopped.ok());
  CHECK(stopped.status().code() == StatusCode::kRuntime);
  const std::string expected =
      fmt::format("stopped at iteration {};", settings.checkpoint_interval);
  REQUIRE(stopped.status().message().find(expected) == 0);
  settings.resume = checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(uninterrupted->gaussians, resumed->gaussians));
}

TEST_CASE("a compaction that is cancelled resumes to the same bits") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(30);
  const Result<Scene> uninterrupted = run(synthetic, settings);
  REQUIRE(uninterrupted.ok());
  REQUIRE(uninterrupted->quantisation);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  const Result<Scene> stopped = run(synthetic, settings, [](const Progress& progress) {
    return progress.detail.find("importance") != 0;
  });
  REQUIRE_FALSE(stopped.ok());
  CHECK(stopped.status().code() == StatusCode::kRuntime);
  CHECK(stopped.status().message().find(
            "stopped at iteration 24, before the importances were complete; resume with") == 0);
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(uninterrupted->gaussians, resumed->gaussians));
  CHECK(uninterrupted->importance == resumed->importance);
  CHECK(uninterrupted->quantisation == resumed->quantisation);
}

TEST_CASE("computing importance reports progress and resumes after cancellation") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(30);
  settings.overrides.emplace_back("compact_share", "0");
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  TrainReport report;
  int reported = 0;
  const auto count = [&](const Progress& progress) {
    reported += progress.stage == "importance" ? 1 : 0;
    return true;
  };
  const Result<Scene> uninterrupted = train(synthetic.capture, settings, count, nullptr, &report);
  REQUIRE(uninterrupted.ok());
  CHECK(reported > 10);
  CHECK(report.importance_seconds > 0);
  REQUIRE(uninterrupted->importance.size() == uninterrupted->gaussians.size());
  const Result<Scene> stopped = run(synthetic, settings, [](const Progress& progress) {
    return progress.stage != "importance" || progress.done < 0.5;
  });
  REQUIRE_FALSE(stopped.ok());
  CHECK(stopped.status().code() == StatusCode::kRuntime);
  CHECK(stopped.status().message().find(
            "stopped at iteration 30, before the importances were complete") == 0);
  settings.resume = std::exchange(settings.checkpoint, "");
  const Result<Scene> again = run(
      synthetic, settings, [](const Progress& progress) { return progress.stage != "importance"; });
  REQUIRE_FALSE(again.ok());
  CHECK(again.status().message().find("resume with --resume " + settings.resume) !=
        std::string::npos);
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(uninterrupted->gaussians, resumed->gaussians));
  CHECK(uninterrupted->importance == resumed->importance);
}

TEST_CASE("the log of a resumed run holds each line once") {
  const SyntheticCapture synthetic;
  const std::string path = synthetic.capture.folder + "/log.jsonl";
  TrainSettings settings = short_run(120);
  settings.log_path = path;
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 70;
  // The run continues past the checkpoint and is killed; the lines of 72 and 96 are left in the
  // log.
  const Result<Scene> stopped = run(synthetic, settings, [&](const Progress& progress) {
    if (progress.stage == "train" && progress.done > 0.8) throw std::runtime_error("killed");
    return true;
  });
  REQUIRE_FALSE(stopped.ok());
  std::ofstream(path, std::ios::app) << "{\"iteration\":98,\"sec";
  settings.resume = settings.checkpoint;
  REQUIRE(run(synthetic, settings).ok());
  const Result<TrainingLog> log = read_training_log(path);
  REQUIRE(log.ok());
  std::vector<std::uint64_t> steps, evaluations;
  for (const LoggedStep& s : log->steps) steps.push_back(s.iteration);
  for (const LoggedEvaluation& m : log->evaluations) evaluations.push_back(m.iteration);
  CHECK(steps == std::vector<std::uint64_t>{1, 50, 100, 120});
  CHECK(evaluations == std::vector<std::uint64_t>{24, 48, 72, 96, 120});
}

TEST_CASE("the coupled representation trains and resumes to the same bits") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(400);
  settings.ablate = "representation";
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 150;
  TrainReport report;
  const Result<Scene> uninterrupted = train(synthetic.capture, settings, nullptr, nullptr, &report);
  REQUIRE(uninterrupted.ok());
  CHECK(held_out_psnr(synthetic, *uninterrupted) > 22.0);
  std::filesystem::remove(settings.checkpoint);
  REQUIRE_FALSE(run(synthetic, settings, [&](const Progress& progress) {
                  return progress.stage != "train" || !std::filesystem::exists(settings.checkpoint);
                }).ok());
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(uninterrupted->gaussians, resumed->gaussians));
}

TEST_CASE("a checkpoint is rejected with other settings or another capture") {
  SyntheticCapture synthetic;
  TrainSettings settings = short_run(10);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  REQUIRE(run(synthetic, settings).ok());
  settings.resume = settings.checkpoint;
  REQUIRE(run(synthetic, settings).ok());
  settings.seed = 2;
  const Status other = run(synthetic, settings).status();
  CHECK(other.code() == StatusCode::kUsage);
  CHECK(other.message().find("Differences (checkpoint, now): seed: 1, now 2") != std::string::npos);
  settings.seed = 1;
  settings.max_seconds = 100;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
  settings.max_seconds = 0;
  synthetic.capture.cameras[1].translation[0] += 0.01;
  const Status other_camera = run(synthetic, settings).status();
  CHECK(other_camera.code() == StatusCode::kUsage);
  CHECK(other_camera.message().find(" camera cam01: number 1, 96x64, calibration ") !=
        std::string::npos);
}

TEST_CASE("a checkpoint of another backend resumes with a warning") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(40);
  settings.backend = "cpu";
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 20;
  REQUIRE_FALSE(run(synthetic, settings, [&](const Progress& progress) {
                  return progress.stage != "train" || !std::filesystem::exists(settings.checkpoint);
                }).ok());
  Result<Checkpoint> checkpoint = read_checkpoint(settings.checkpoint);
  REQUIRE(checkpoint.ok());
  for (auto& [name, value] : checkpoint->fingerprint) {
    if (name == kBackendEntry) value = "abacus";
  }
  REQUIRE(write_checkpoint(settings.checkpoint, checkpoint->state, checkpoint->fingerprint).ok());
  settings.resume = settings.checkpoint;
  std::string warning;
  const auto log = [&](int level, const std::string& line) {
    if (level == 1) warning = line;
  };
  REQUIRE(train(synthetic.capture, settings, nullptr, log, nullptr).ok());
  CHECK(warning.find("written with the backend abacus and resumed with cpu") != std::string::npos);
}

TEST_CASE("a checkpoint whose state is not that of the run is rejected") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(4);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  REQUIRE(run(synthetic, settings).ok());
  const Result<Checkpoint> checkpoint = read_checkpoint(settings.checkpoint);
  REQUIRE(checkpoint.ok());
  settings.resume = settings.checkpoint;
  const auto resume = [&](const TrainState& state) {
    REQUIRE(write_checkpoint(settings.checkpoint, state, checkpoint->fingerprint).ok());
    return run(synthetic, settings).status();
  };
  CHECK(resume(checkpoint->state).ok());
  TrainState cameras = checkpoint->state;  // the frames of the last camera would read past the end
  for (auto* maps : {&cameras.colour, &cameras.colour_first, &cameras.colour_second})
    maps->pop_back();
  cameras.colour_updates.pop_back();
  CHECK(resume(cameras).code() == StatusCode::kInvalidFile);
  TrainState refined = checkpoint->state;  // without --refine-cameras
  begin_refinement(refined.colour.size(), refined);
  CHECK(resume(refined).code() == StatusCode::kInvalidFile);
  TrainState degree;  // as would the gradients of SH
  degree.resize(checkpoint->state.size());
  degree.colour = checkpoint->state.colour;
  degree.colour_first = checkpoint->state.colour_first;
  degree.colour_second = checkpoint->state.colour_second;
  degree.colour_updates = checkpoint->state.colour_updates;
  CHECK(resume(degree).code() == StatusCode::kInvalidFile);
  TrainState late = checkpoint->state;
  late.iteration = std::uint64_t{1} << 40;
  CHECK(resume(late).code() == StatusCode::kInvalidFile);
  TrainState nothing = checkpoint->state;
  nothing.compaction.prunings = 1;  // but none was chosen
  nothing.compaction.keep = 0;
  CHECK(resume(nothing).code() == StatusCode::kInvalidFile);
}

TEST_CASE("a checkpoint with impossible corrections of cameras is rejected") {
  const SyntheticCapture synthetic(5);
  TrainSettings settings = short_run(4);
  settings.refine_cameras = true;
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  REQUIRE(run(synthetic, settings).ok());
  const Result<Checkpoint> checkpoint = read_checkpoint(settings.checkpoint);
  REQUIRE(checkpoint.ok());
  settings.resume = settings.checkpoint;
  const auto resume = [&](const std::function<void(TrainState&)>& change) {
    TrainState state = checkpoint->state;
    change(state);
    REQUIRE(write_checkpoint(settings.checkpoint, state, checkpoint->fingerprint).ok());
    return run(synthetic, settings).status().code();
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(resume([](TrainState&) {}) == StatusCode::kOk);
  CHECK(resume([](TrainState& s) { s.cameras.clear(); }) == StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { begin_refinement(2, s); }) == StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { begin_refinement(0, s); }) == StatusCode::kInvalidFile);
  CHECK(resume([&](TrainState& s) { s.cameras[1][2] = nan; }) == StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { s.cameras[1][kLogFocal] = 50; }) == StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { s.cameras[1][kDistortion] = 0.4f; }) ==
        StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { s.cameras[1][kVignetting] = -0.7f; }) ==
        StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { s.cameras[1][kTimeShift] = 1.1f; }) == StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { s.cameras_second[0][0] = -1; }) == StatusCode::kInvalidFile);
  CHECK(resume([&](TrainState& s) { s.camera_sums[0][0] = nan; }) == StatusCode::kInvalidFile);
  CHECK(resume([](TrainState& s) { s.camera_updates[0] = 0xFFFFFFFF; }) ==
        StatusCode::kInvalidFile);
}

TEST_CASE("resuming a completed run returns its held-out score") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(30);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  TrainReport first, again;
  REQUIRE(train(synthetic.capture, settings, nullptr, nullptr, &first).ok());
  settings.resume = settings.checkpoint;
  REQUIRE(train(synthetic.capture, settings, nullptr, nullptr, &again).ok());
  REQUIRE(first.held_out);
  REQUIRE(again.held_out);
  CHECK(again.iterations == 30);
  CHECK(again.held_out->psnr == first.held_out->psnr);
  CHECK(again.held_out->images == first.held_out->images);
}

TEST_CASE("check_training() rejects invalid settings without the capture") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(10);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  CHECK(check_training(settings, nullptr).ok());
  CHECK(check_training(settings, &synthetic.capture).ok());
  settings.resume = settings.checkpoint;
  CHECK(check_training(settings, nullptr).code() == StatusCode::kIo);
  settings.resume = "";
  REQUIRE(run(synthetic, settings).ok());
  settings.resume = settings.checkpoint;
  CHECK(check_training(settings, nullptr).ok());
  settings.overrides.emplace_back("lr_time", "1");
  CHECK(check_training(settings, nullptr).message().find("lr_time: 0.01, now 1") !=
        std::string::npos);
  settings.overrides.emplace_back("lr_time", "soon");
  CHECK(check_training(settings, nullptr).code() == StatusCode::kUsage);
  settings = short_run(10);
  settings.ablate = "magic";
  CHECK(check_training(settings, nullptr).code() == StatusCode::kUsage);
  settings.ablate = "";
  settings.backend = "vulkan";
  CHECK(check_training(settings, nullptr).code() == StatusCode::kNotBuilt);
}
