// SPDX-License-Identifier: Apache-2.0
// The C interface of the encoder: from a capture to a scene that is drawn, stopped at any stage,
// and resumed.
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <cmath>
#include <thread>

#include "sdk_encoder_fixture.h"
#include "stgs/encoder/train.h"

namespace stgs::testing {

TEST_CASE("a capture is prepared, trained, packed, opened and drawn", "[sdk]") {
  const TemporaryFolder work;
  const Watched encoder;
  stgs_prepare_settings preparing;
  REQUIRE(stgs_prepare_settings_defaults(&preparing, sizeof preparing) == STGS_OK);
  const char* const held_out[] = {"cam00", "cam06"};
  preparing.default_test_cameras = 0;
  preparing.test_cameras = held_out;
  preparing.test_camera_count = 2;
  preparing.end_frame = 2;
  preparing.scale = 0.25;
  preparing.max_static_points = 1000;
  preparing.max_dynamic_points = 100;
  // Of a program with a later header, in which it is longer.
  Sized<stgs_prepare_report> longer(sizeof(stgs_prepare_report) + 8, {}, 0xA5);
  const std::string folder = work / "prepared", scene = work / "trained.stgs";
  const stgs_result result = stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop",
                                                  folder.c_str(), &preparing, longer.get());
  INFO(encoder.error().message);
#ifndef STGS_HAS_PREPARE
  CHECK(result == STGS_ERROR_NOT_BUILT);
  CHECK(std::string(encoder.error().message).find("OpenCV") != std::string::npos);
  CHECK(names_in(work.path).empty());
  return;
#endif
  REQUIRE(result == STGS_OK);
  const stgs_prepare_report& prepared = *longer.get();
  CHECK(prepared.struct_size == sizeof prepared + 8);
  CHECK(longer.last() == 0);
  CHECK(prepared.cameras == 10);
  CHECK(prepared.test_cameras == 2);
  CHECK(prepared.frames == 2);
  CHECK(prepared.frames_per_second == Approx(30));

  const stgs_train_settings training = short_training(20);
  auto trained = empty_report<stgs_train_report>();
  REQUIRE(stgs_encoder_train(encoder.get(), folder.c_str(), scene.c_str(), &training, &trained) ==
          STGS_OK);
  CHECK(trained.backend == STGS_BACKEND_CPU);
  CHECK(trained.iterations == 20);
  CHECK(trained.primitives <= 600);
  CHECK(trained.bytes == fs::file_size(scene));
  CHECK(trained.loss > 0);
  CHECK(trained.held_out_psnr > 5);
  CHECK(trained.held_out_images == 4);
  CHECK(encoder.last_training.iteration == 20);
  CHECK(encoder.last_training.iterations == 20);
  CHECK(encoder.last_training.primitives == trained.primitives);
  CHECK(encoder.last_training.loss == trained.loss);
  CHECK(encoder.last_training.held_out_psnr == trained.held_out_psnr);
  CHECK(encoder.last_training.done == 1);

  stgs_pack_settings settings = packing();
  settings.against = folder.c_str();
  auto packed = empty_report<stgs_pack_report>();
  REQUIRE(pack_one(encoder, scene, work / "scene.stgs", &settings, &packed) == STGS_OK);
  CHECK(packed.primitives + packed.dropped == trained.primitives);
  CHECK(packed.bytes_in == trained.bytes);
  CHECK(packed.bytes_out == fs::file_size(work / "scene.stgs"));
  CHECK(packed.bytes_out < packed.bytes_in);
  CHECK(packed.quality == settings.quality);
  CHECK(packed.images_psnr > 25);
  CHECK(packed.held_out_before == Approx(trained.held_out_psnr).margin(1));
  CHECK(packed.held_out_after == Approx(packed.held_out_before).margin(1));
  CHECK(encoder.monotone);
  for (const char* stage : {"frames", "depth range", "velocities", "load", "train", "pack"}) {
    INFO(stage);
    CHECK(encoder.saw(stage));
  }
  CHECK_FALSE(encoder.lines.empty());
  CHECK(names_in(work.path) == std::vector<std::string>{"prepared", "scene.stgs", "trained.stgs"});

  const ScenePtr opened = make_scene();
  REQUIRE(stgs_scene_open(opened.get(), (work / "scene.stgs").c_str()) == STGS_OK);
  const stgs_view view = start_view(opened.get());
  const auto pixels = draw_rgba8(cpu_renderer().get(), opened.get(), 0.03, view);
  CHECK(view.width == 120);
  std::size_t opaque = 0;
  for (std::size_t i = 3; i < pixels.size(); i += 4) opaque += pixels[i] > 127 ? 1 : 0;
  CHECK(opaque > pixels.size() / 8);
}

#ifdef STGS_HAS_PREPARE
TEST_CASE("preparing that is stopped leaves nothing", "[sdk]") {
  const TemporaryFolder work;
  Watched encoder;
  const std::string at = GENERATE("frames", "motion", "depth range");
  encoder.stop = [&](const stgs_encoder_progress& progress) { return progress.stage == at; };
  stgs_prepare_settings settings;
  REQUIRE(stgs_prepare_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.end_frame = 2;
  settings.scale = 0.25;
  auto report = empty_report<stgs_prepare_report>();
  report.frames = 77;
  CHECK(stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop", (work / "out").c_str(),
                             &settings, &report) == STGS_ERROR_CANCELLED);
  CHECK(encoder.error().result == STGS_ERROR_CANCELLED);
  CHECK(encoder.stages.back() == at);
  CHECK(encoder.calls_after_stop == 0);
  CHECK(report.frames == 77);
  CHECK(names_in(work.path).empty());
}
#endif

TEST_CASE("training that is stopped leaves its checkpoint, and goes on to the same bits", "[sdk]") {
  const Prepared prepared;
  stgs_train_settings settings = short_training();
  const std::string whole = prepared.at("whole.stgs"), part = prepared.at("part.stgs");
  const std::string checkpoint = prepared.at("run.ckpt");
  {
    const Watched encoder;
    REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), whole.c_str(), &settings,
                               nullptr) == STGS_OK);
  }
  settings.checkpoint = checkpoint.c_str();
  settings.checkpoint_interval = 25;
  Watched encoder;
  // At an interval, when there is something to go on from.
  encoder.stop = [&](const stgs_encoder_progress& progress) {
    return progress.stage == std::string("train") && fs::exists(checkpoint);
  };
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), part.c_str(), &settings,
                             nullptr) == STGS_ERROR_CANCELLED);
  CHECK(std::string(encoder.error().message).find(checkpoint) != std::string::npos);
  CHECK(encoder.calls_after_stop == 0);
  CHECK_FALSE(fs::exists(part));
  REQUIRE(fs::exists(checkpoint));
  const auto stopped_at = encoder.last_training.iteration;
  CHECK(stopped_at >= 25);
  CHECK(stopped_at < 60);

  // The callback ended that call alone. In two threads now, which changes no bit.
  Watched other(2);
  settings.resume = checkpoint.c_str();
  auto report = empty_report<stgs_train_report>();
  REQUIRE(stgs_encoder_train(other.get(), prepared.folder().c_str(), part.c_str(), &settings,
                             &report) == STGS_OK);
  CHECK(report.iterations == 60);
  CHECK(other.monotone);
  CHECK(bytes_of(part) == bytes_of(whole));
  encoder.stop = nullptr;
  const std::string again = prepared.at("again.stgs");
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), again.c_str(), &settings,
                             nullptr) == STGS_OK);
  CHECK(bytes_of(again) == bytes_of(whole));
}

TEST_CASE("another thread stops an encoder for good", "[sdk]") {
  const Prepared prepared;
  Watched encoder;
  std::atomic<bool> training{false};
  encoder.stop = [&](const stgs_encoder_progress& progress) {
    if (progress.stage == std::string("train")) {
      training = true;
      training.notify_one();
    }
    return false;
  };
  // Of no use to wait for: it ends in minutes, or when it is told to.
  const stgs_train_settings settings = short_training(100000);
  const std::string scene = prepared.at("scene.stgs");
  stgs_result result = STGS_OK;
  std::thread worker([&] {
    result = stgs_encoder_train(encoder.get(), prepared.folder().c_str(), scene.c_str(), &settings,
                                nullptr);
  });
  training.wait(false);
  stgs_encoder_cancel(encoder.get());
  worker.join();
  CHECK(result == STGS_ERROR_CANCELLED);
  CHECK_FALSE(fs::exists(scene));
  CHECK(pack_one(encoder, scene, prepared.at("packed.stgs")) == STGS_ERROR_CANCELLED);
  CHECK(std::string(encoder.error().message).find("another") != std::string::npos);
  stgs_encoder_cancel(nullptr);
}

TEST_CASE("packing that is stopped leaves what was there", "[sdk]") {
  const Prepared prepared;
  Watched encoder;
  const stgs_train_settings training = short_training(10);
  const std::string scene = prepared.at("scene.stgs"), output = prepared.at("packed.stgs");
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), scene.c_str(), &training,
                             nullptr) == STGS_OK);
  std::ofstream(output) << "before";
  encoder.stop = [](const stgs_encoder_progress& progress) {
    return progress.stage == std::string("pack") && progress.done >= 0.8;
  };
  CHECK(pack_one(encoder, scene, output) == STGS_ERROR_CANCELLED);
  CHECK(encoder.stages.back() == "pack");
  const std::string before = "before";
  CHECK(bytes_of(output) == Bytes(before.begin(), before.end()));
  encoder.stop = nullptr;
  CHECK(pack_one(encoder, scene, output) == STGS_OK);
  CHECK(fs::file_size(output) > 100);

  // Its own input is not lost, by whatever name.
  CHECK(pack_one(encoder, scene, prepared.at("./scene.stgs")) == STGS_ERROR_ARGUMENT);
  CHECK(pack_one(encoder, prepared.at("none.stgs"), output) == STGS_ERROR_IO);
  stgs_pack_settings settings = packing();
  settings.target_kbps = 0.01;
  CHECK(pack_one(encoder, scene, output, &settings) == STGS_ERROR_ARGUMENT);
  settings = packing();
  settings.floor[1] = 1;
  settings.has_floor = 1;
  CHECK(pack_one(encoder, scene, output, &settings) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(encoder.error().message).find("up") != std::string::npos);
  settings.up[1] = -2;
  settings.metres_per_unit = 0.5;
  settings.audio = "audio.ogg";
  REQUIRE(pack_one(encoder, scene, output, &settings) == STGS_OK);
  const ScenePtr opened = make_scene();
  REQUIRE(stgs_scene_open(opened.get(), output.c_str()) == STGS_OK);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  REQUIRE(stgs_scene_get_info(opened.get(), &info) == STGS_OK);
  CHECK(info.up[1] == -1);
  CHECK(info.floor[1] == 1);
  CHECK(info.metres_per_unit == 0.5f);
}

TEST_CASE("an encoder keeps to its threads, and gives the process its own back", "[sdk]") {
  const Prepared prepared;
  Watched encoder(1);
  int threads = 0;
  encoder.stop = [&](const stgs_encoder_progress&) {
    const auto limit =
        tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
    threads = std::max(threads,
                       std::min(tbb::this_task_arena::max_concurrency(), static_cast<int>(limit)));
    return false;
  };
  const auto before =
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  const stgs_train_settings settings = short_training(5);
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(),
                             prepared.at("scene.stgs").c_str(), &settings, nullptr) == STGS_OK);
  CHECK(threads == 1);
#ifdef STGS_HAS_PREPARE
  threads = 0;
  stgs_prepare_settings preparing;
  REQUIRE(stgs_prepare_settings_defaults(&preparing, sizeof preparing) == STGS_OK);
  preparing.end_frame = 1;
  preparing.scale = 0.1;
  CHECK(stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop", prepared.at("out").c_str(),
                             &preparing, nullptr) == STGS_OK);
  CHECK(threads == 1);
#endif
  CHECK(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism) == before);
}

TEST_CASE("windows of a capture are trained apart and packed together", "[sdk]") {
  const Prepared prepared;
  Watched encoder;
  stgs_train_settings settings = short_training(10);
  const std::string parts[] = {prepared.at("0-4.stgs"), prepared.at("2-6.stgs")};
  for (int i = 0; i < 2; ++i) {
    settings.first_frame = 2 * i;
    settings.end_frame = i == 0 ? 4 : -1;
    REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), parts[i].c_str(),
                               &settings, nullptr) == STGS_OK);
  }
  const char* const scenes[] = {parts[1].c_str(), parts[0].c_str()};
  const std::string output = prepared.at("whole.stgs");
  REQUIRE(stgs_encoder_pack(encoder.get(), scenes, 2, output.c_str(), nullptr, nullptr) == STGS_OK);
  const ScenePtr opened = make_scene();
  REQUIRE(stgs_scene_open(opened.get(), output.c_str()) == STGS_OK);
  stgs_scene_info info{};
  info.struct_size = sizeof info;
  REQUIRE(stgs_scene_get_info(opened.get(), &info) == STGS_OK);
  CHECK(info.frames == 6);
}

}  // namespace stgs::testing
