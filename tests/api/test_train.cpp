// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <utility>

#include <tbb/global_control.h>
#include "../kernels/thread_ranks.h"
#include "catch.h"
#include "stgs/encoder/train.h"
#include "stgs/encoder/training_log.h"
#include "synthetic_capture.h"
#include "train/checkpoint.h"
#include "train_run.h"

using namespace stgs;
using namespace stgs::encoder;
using stgs::test::held_out_psnr;
using stgs::test::run;
using stgs::test::same;
using stgs::test::short_run;
using stgs::test::SyntheticCapture;

TEST_CASE("training from rough grey points recovers a held-out view") {
  const SyntheticCapture synthetic;
  const Result<Scene> start = run(synthetic, short_run(1));
  REQUIRE(start.ok());
  const Result<Scene> scene = run(synthetic, short_run(600));
  REQUIRE(scene.ok());
  const double before = held_out_psnr(synthetic, *start);
  const double after = held_out_psnr(synthetic, *scene);
  CAPTURE(before, after);
  CHECK(after > before + 6.0);
  CHECK(after > 24.0);
  CHECK(scene->gaussians.size() <= 600);
  CHECK(scene->metadata.frames == 6);
}

TEST_CASE("two ranks recover a held-out view as one does, with as many views") {
  const SyntheticCapture synthetic;
  const Result<Scene> alone = run(synthetic, short_run(1200));
  REQUIRE(alone.ok());
  std::vector<Scene> scenes(2);
  std::vector<int> processes(2);
  std::vector<std::string> logged(2);
  stgs::testing::on_ranks(2, [&](Ranks& ranks) {
    const auto r = static_cast<std::size_t>(ranks.rank());
    TrainSettings settings = short_run(1200);
    settings.ranks = &ranks;
    TrainReport report;
    const auto log = [&](int, const std::string& line) { logged[r] += line + "\n"; };
    Result<Scene> scene = train(synthetic.capture, settings, nullptr, log, &report);
    processes[r] = report.processes;
    if (scene.ok()) scenes[r] = std::move(*scene);
  });
  CAPTURE(logged[0], logged[1]);
  REQUIRE(processes == std::vector<int>{2, 2});
  CHECK(same(scenes[0].gaussians, scenes[1].gaussians));
  const double one = held_out_psnr(synthetic, *alone);
  const double two = held_out_psnr(synthetic, scenes[0]);
  CAPTURE(one, two);
  CHECK(two > one - 0.5);
}

TEST_CASE("a run that was interrupted and resumed ends with the same bits") {
  const SyntheticCapture synthetic;
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

TEST_CASE(
    "weighing the primitives after the last step is told, can be stopped, and is made up for") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(30);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  TrainReport report;
  int told = 0;
  const auto count = [&](const Progress& progress) {
    told += progress.stage == "importance" ? 1 : 0;
    return true;
  };
  const Result<Scene> whole = train(synthetic.capture, settings, count, nullptr, &report);
  REQUIRE(whole.ok());
  CHECK(told > 10);
  CHECK(report.importance_seconds > 0);
  REQUIRE(whole->importance.size() == whole->gaussians.size());
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
  CHECK(same(whole->gaussians, resumed->gaussians));
  CHECK(whole->importance == resumed->importance);
}

TEST_CASE("measuring held-out views changes nothing and says what it sees") {
  const SyntheticCapture synthetic;
  const std::string path = synthetic.capture.folder + "/log.jsonl";
  TrainSettings settings = short_run(60);
  settings.held_out_evaluations = 0;
  const Result<Scene> without = run(synthetic, settings);
  settings.held_out_evaluations = 7;
  settings.log_path = path;
  TrainReport report;
  const Result<Scene> with = train(synthetic.capture, settings, nullptr, nullptr, &report);
  REQUIRE(without.ok());
  REQUIRE(with.ok());
  CHECK(same(without->gaussians, with->gaussians));

  const Result<TrainingLog> log = read_training_log(path);
  REQUIRE(log.ok());
  std::vector<std::uint64_t> iterations;
  for (const LoggedEvaluation& m : log->evaluations) iterations.push_back(m.iteration);
  CHECK(iterations == std::vector<std::uint64_t>{9, 18, 26, 35, 43, 52, 60});
  REQUIRE(log->steps.size() == 3);  // the first, the 50th, the last
  CHECK(log->steps.back().iteration == 60);
  // Six frames, one test camera: the sample is all that there is, and the last measure the end.
  REQUIRE(report.held_out);
  CHECK(report.held_out->images == 6);
  CHECK(report.held_out->psnr == log->evaluations.back().score.psnr);
  CHECK(report.held_out->psnr ==
        Approx(held_out_psnr(synthetic, *with)).margin(0.05));  // of 8-bit truth
  CHECK(report.held_out->psnr_cc >= report.held_out->psnr);
  CHECK(report.held_out->psnr > log->evaluations.front().score.psnr);
}

TEST_CASE("held-out views that cannot be read are told of and do not stop the training") {
  const SyntheticCapture synthetic;
  std::filesystem::remove(synthetic.capture.frame_path(synthetic.capture.cameras[0], 2));
  REQUIRE(synthetic.capture.cameras[0].test);
  std::string warning;
  TrainReport report;
  const auto log = [&](int level, const std::string& line) {
    if (level == 1) warning = line;
  };
  REQUIRE(train(synthetic.capture, short_run(5), nullptr, log, &report).ok());
  CHECK(warning.find("000002.png") != std::string::npos);
  CHECK_FALSE(report.held_out);
}

TEST_CASE("a resumed log holds each line once, as if nothing had happened") {
  const SyntheticCapture synthetic;
  const std::string path = synthetic.capture.folder + "/log.jsonl";
  TrainSettings settings = short_run(120);
  settings.log_path = path;
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 70;
  // Goes on for a while after the checkpoint, then is lost: lines of 72 and 96 are left behind.
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
  std::vector<std::uint64_t> steps, measures;
  for (const LoggedStep& s : log->steps) steps.push_back(s.iteration);
  for (const LoggedEvaluation& m : log->evaluations) measures.push_back(m.iteration);
  CHECK(steps == std::vector<std::uint64_t>{1, 50, 100, 120});
  CHECK(measures == std::vector<std::uint64_t>{24, 48, 72, 96, 120});
}

TEST_CASE("the sample of views is spread over cameras and time") {
  PreparedCapture capture;
  capture.frames = 40;
  capture.cameras.resize(12);
  for (std::size_t i = 0; i < 12; i += 3) capture.cameras[i].test = true;
  const std::vector<SampledView> few = sample_views(capture, true, 8);
  REQUIRE(few.size() == 8);
  std::vector<int> frames;
  for (const SampledView& view : few) {
    CHECK(capture.cameras[view.camera].test);
    CHECK(view.camera == few[frames.size() % 4].camera);
    frames.push_back(view.frame);
  }
  CHECK(frames == std::vector<int>{2, 7, 12, 17, 22, 27, 32, 37});
  CHECK(sample_views(capture, false, 4).back().camera == 10);
  CHECK(sample_views(capture, true, 0).empty());
  capture.frames = 1;
  CHECK(sample_views(capture, true, 8).size() == 4);
}

TEST_CASE("L_n is on from its share of the run, is logged, and resumes to the same bits") {
  const SyntheticCapture synthetic;
  const std::string path = synthetic.capture.folder + "/log.jsonl";
  TrainSettings settings = short_run(200);
  settings.overrides.emplace_back("weight_normal", "0.02");
  settings.overrides.emplace_back("normal_from", "0.4");
  settings.log_path = path;
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 120;
  const Result<Scene> whole = run(synthetic, settings);
  REQUIRE(whole.ok());
  const Result<TrainingLog> log = read_training_log(path);
  REQUIRE(log.ok());
  REQUIRE(log->steps.size() == 5);  // 1, 50, 100, 150, 200
  for (const LoggedStep& step : log->steps) CHECK((step.normal > 0.0) == (step.iteration > 80));
  REQUIRE_FALSE(run(synthetic, settings, [](const Progress& p) { return p.done < 0.6; }).ok());
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(whole->gaussians, resumed->gaussians));

  settings.resume.clear();
  settings.ablate = "representation";
  const Status refused = run(synthetic, settings).status();
  CHECK(refused.code() == StatusCode::kUsage);
  CHECK(refused.message().find("weight_normal=0.02 has no effect") != std::string::npos);
}

TEST_CASE("the coupled representation trains, and resumes to the same bits") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(400);
  settings.ablate = "representation";
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  settings.checkpoint_interval = 150;
  TrainReport report;
  const Result<Scene> whole = train(synthetic.capture, settings, nullptr, nullptr, &report);
  REQUIRE(whole.ok());
  CHECK(held_out_psnr(synthetic, *whole) > 22.0);
  std::filesystem::remove(settings.checkpoint);
  REQUIRE_FALSE(run(synthetic, settings, [&](const Progress& progress) {
                  return progress.stage != "train" || !std::filesystem::exists(settings.checkpoint);
                }).ok());
  settings.resume = settings.checkpoint;
  const Result<Scene> resumed = run(synthetic, settings);
  REQUIRE(resumed.ok());
  CHECK(same(whole->gaussians, resumed->gaussians));
}

TEST_CASE("a checkpoint is only for the settings and the capture that it was made with") {
  SyntheticCapture synthetic;
  TrainSettings settings = short_run(10);
  settings.checkpoint = synthetic.capture.folder + "/train.ckpt";
  REQUIRE(run(synthetic, settings).ok());
  settings.resume = settings.checkpoint;
  REQUIRE(run(synthetic, settings).ok());
  settings.seed = 2;
  const Status other = run(synthetic, settings).status();
  CHECK(other.code() == StatusCode::kUsage);
  CHECK(other.message().find("Differences (checkpoint, now):\n  seed: 1, now 2") !=
        std::string::npos);
  settings.seed = 1;
  settings.max_seconds = 100;
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
  settings.max_seconds = 0;
  synthetic.capture.cameras[1].translation[0] += 0.01;
  const Status moved = run(synthetic, settings).status();
  CHECK(moved.code() == StatusCode::kUsage);
  CHECK(moved.message().find("\n  camera cam01: number 1, 96x64, calibration ") !=
        std::string::npos);
}

TEST_CASE("a checkpoint of another backend is resumed with a warning") {
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

TEST_CASE("a run that had ended is resumed with its held-out score") {
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

TEST_CASE("what training would refuse is found without the capture") {
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

TEST_CASE("'auto' says what it trains on, and why not on CUDA where it does not") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(1);
  std::string lines;
  TrainReport report;
  const auto log = [&](int level, const std::string& line) {
    if (level == 2) lines += line + "\n";
  };
  REQUIRE(train(synthetic.capture, settings, nullptr, log, &report).ok());
  CHECK(lines.find("training on " + report.backend) != std::string::npos);
  const bool cpu = report.backend.rfind("cpu", 0) == 0;
  CHECK((lines.find("CUDA unavailable (") != std::string::npos) == cpu);
  settings.backend = "cpu";
  lines.clear();
  REQUIRE(train(synthetic.capture, settings, nullptr, log, &report).ok());
  CHECK(lines.find("no CUDA") == std::string::npos);
}

TEST_CASE("the number of threads does not change a bit of the result") {
  const SyntheticCapture synthetic;
  const TrainSettings settings = short_run(60);
  const Result<Scene> many = run(synthetic, settings);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Result<Scene> single = run(synthetic, settings);
  REQUIRE(many.ok());
  REQUIRE(single.ok());
  CHECK(same(many->gaussians, single->gaussians));
}

TEST_CASE("every ablation takes away what its name says") {
  const SyntheticCapture synthetic;
  TrainSettings settings = short_run(40);
  settings.ablate = "lifespan";
  const Result<Scene> lifespan = run(synthetic, settings);
  REQUIRE(lifespan.ok());
  for (float r : lifespan->gaussians.radius) CHECK(r == 0.0f);

  settings.ablate = "initialisation";
  const Result<Scene> initialisation = run(synthetic, settings);
  REQUIRE(initialisation.ok());
  for (float s : initialisation->gaussians.sigma) CHECK(s > 6.0f);  // nothing starts short-lived

  const SyntheticCapture still;
  REQUIRE(encoder::write_points(still.capture.folder + "/points_dynamic.ply", {}).ok());
  const Result<Scene> idle = run(still, settings);
  REQUIRE_FALSE(idle.ok());
  CHECK(idle.status().code() == StatusCode::kUsage);
  CHECK(idle.status().message().find("has no dynamic points") != std::string::npos);

  settings.ablate = "initialisation,lifespan";
  const Result<Scene> both = run(synthetic, settings);
  REQUIRE(both.ok());
  for (float r : both->gaussians.radius) CHECK(r == 0.0f);
  for (float s : both->gaussians.sigma) CHECK(s > 6.0f);

  settings.ablate = "representation";
  const Result<Scene> representation = run(synthetic, settings);
  REQUIRE(representation.ok());
  for (float r : representation->gaussians.radius) CHECK(r == 0.0f);
  CHECK_FALSE(same(representation->gaussians, lifespan->gaussians));

  settings.ablate = "densification";
  const Result<Scene> densification = run(synthetic, settings);
  REQUIRE(densification.ok());
  CHECK(densification->gaussians.size() <= 600);

  settings.ablate = "modulation";
  settings.iterations = 1;
  const Result<Scene> modulation = run(synthetic, settings);
  settings.ablate = "";
  const Result<Scene> full = run(synthetic, settings);
  REQUIRE(modulation.ok());
  REQUIRE(full.ok());
  CHECK_FALSE(same(modulation->gaussians, full->gaussians));

  settings.ablate = "lifespan,magic";
  CHECK(run(synthetic, settings).status().code() == StatusCode::kUsage);
}

TEST_CASE("wrong settings and wrong captures are refused with their reason") {
  SyntheticCapture synthetic(4, 2);
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
