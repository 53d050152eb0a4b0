// SPDX-License-Identifier: Apache-2.0
#include <catch2/catch.hpp>
#include <filesystem>

#include <tbb/global_control.h>
#include "stgs/encoder/train.h"
#include "synthetic_capture.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::held_out_psnr;
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

TEST_CASE("training from rough grey points recovers a held-out view") {
  const SyntheticCapture synthetic("train_quality");
  const Result<Scene> start = run(synthetic, short_run(1));
  REQUIRE(start.ok());
  const Result<Scene> scene = run(synthetic, short_run(600));
  REQUIRE(scene.ok());
  const double before = held_out_psnr(synthetic, start->gaussians);
  const double after = held_out_psnr(synthetic, scene->gaussians);
  CAPTURE(before, after);
  CHECK(after > before + 6.0);
  CHECK(after > 24.0);
  CHECK(scene->gaussians.size() <= 600);
  CHECK(scene->metadata.frames == 6);
}

TEST_CASE("a run that was interrupted and resumed ends with the same bits") {
  const SyntheticCapture synthetic("train_resume");
  const std::string checkpoint = synthetic.capture.folder + "/train.ckpt";
  TrainSettings settings = short_run(120);
  const Result<Scene> whole = run(synthetic, settings);
  REQUIRE(whole.ok());

  // 35 of 120: growth, the border of the stages and replacement are still to come. 70: replacement.
  settings.checkpoint_interval = GENERATE(35, 70);
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
  CHECK(same(whole->gaussians, resumed->gaussians));
}

TEST_CASE("a checkpoint is only for the settings and the capture that it was made with") {
  SyntheticCapture synthetic("train_fingerprint");
  TrainSettings settings = short_run(10);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  REQUIRE(run(synthetic, settings).ok());
  settings.resume = settings.checkpoint;
  REQUIRE(run(synthetic, settings).ok());
  settings.seed = 2;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
  settings.seed = 1;
  settings.max_seconds = 100;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
  settings.max_seconds = 0;
  synthetic.capture.cameras[1].translation[0] += 0.01;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
}

TEST_CASE("the number of threads does not change a bit of the result") {
  const SyntheticCapture synthetic("train_threads");
  const TrainSettings settings = short_run(60);
  const Result<Scene> many = run(synthetic, settings);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Result<Scene> single = run(synthetic, settings);
  REQUIRE(many.ok());
  REQUIRE(single.ok());
  CHECK(same(many->gaussians, single->gaussians));
}

TEST_CASE("every ablation takes away what its name says") {
  const SyntheticCapture synthetic("train_ablations");
  TrainSettings settings = short_run(40);
  settings.ablate = "radius";
  const Result<Scene> radius = run(synthetic, settings);
  REQUIRE(radius.ok());
  for (float r : radius->gaussians.radius) CHECK(r == 0.0f);

  settings.ablate = "split";
  const Result<Scene> split = run(synthetic, settings);
  REQUIRE(split.ok());
  for (float s : split->gaussians.sigma) CHECK(s > 6.0f);  // nothing starts short-lived

  settings.ablate = "modulation";
  settings.iterations = 1;
  const Result<Scene> modulation = run(synthetic, settings);
  settings.ablate = "";
  const Result<Scene> full = run(synthetic, settings);
  REQUIRE(modulation.ok());
  REQUIRE(full.ok());
  CHECK_FALSE(same(modulation->gaussians, full->gaussians));

  settings.ablate = "magic";
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
}

TEST_CASE("wrong settings and wrong captures are refused with their reason") {
  SyntheticCapture synthetic("train_errors", 4, 2);
  TrainSettings settings = short_run(10);
  settings.overrides = {{"lr_positron", "1"}};
  const Result<Scene> unknown = run(synthetic, settings);
  CHECK(unknown.status().code() == StatusCode::kUsage);
  CHECK(unknown.status().message().find("lr_position") != std::string::npos);
  settings.overrides = {{"lr_position", "fast"}};
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
  settings.overrides = {};

  const std::string frame = synthetic.capture.frame_path(synthetic.capture.cameras[2], 1);
  std::filesystem::remove(frame);
  const Result<Scene> missing = run(synthetic, settings);
  CHECK(missing.status().code() == StatusCode::kIo);
  CHECK(missing.status().message().find("cam02/000001.png") != std::string::npos);

  for (Camera& camera : synthetic.capture.cameras) camera.test = true;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
}
