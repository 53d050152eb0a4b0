// SPDX-License-Identifier: Apache-2.0
// The encoder of the C API: from a capture to a rendered scene, cancellation at every stage, and
// resuming.

#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <thread>

#include "sdk_encoder_fixture.h"
#include "stgs/encoder/train.h"

namespace stgs::testing {

TEST_CASE("a capture is prepared, trained, packed, opened and rendered", "[sdk]") {
  const TemporaryFolder work;
  const ObservedEncoder encoder;
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
  // As passed by a program with a newer header, in which the struct is longer.
  Sized<stgs_prepare_report> longer(sizeof(stgs_prepare_report) + 8, {}, 0xA5);
  const std::string folder = work / "prepared", scene = work / "trained.stgs";
  const stgs_result result = stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop",
                                                  folder.c_str(), &preparing, longer.get());
  INFO(encoder.error().message);
#ifndef STGS_HAS_PREPARE
  CHECK(result == STGS_ERROR_NOT_BUILT);
  CHECK(std::string(encoder.error().message).find("OpenCV") != std::string::npos);
  CHECK(file_names_in(work.path).empty());
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
  auto trained = empty_output<stgs_train_report>();
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

  stgs_pack_settings settings = pack_settings();
  settings.against = folder.c_str();
  auto packed = empty_output<stgs_pack_report>();
  REQUIRE(pack_one(encoder, scene, work / "scene.stgs", &settings, &packed) == STGS_OK);
  CHECK(packed.primitives + packed.dropped == trained.primitives);
  CHECK(packed.bytes_in == trained.bytes);
  CHECK(packed.bytes_out == fs::file_size(work / "scene.stgs"));
  CHECK(packed.bytes_out < packed.bytes_in);
  CHECK(packed.quality == 80);  // that the scene was trained for
  CHECK(packed.images_psnr > 25);
  CHECK(packed.held_out_before == Approx(trained.held_out_psnr).margin(1));
  CHECK(packed.held_out_after == Approx(packed.held_out_before).margin(1));
  CHECK(encoder.is_monotonic);
  for (const char* stage : {"frames", "depth range", "velocities", "load", "train", "pack"}) {
    INFO(stage);
    CHECK(encoder.has_reported(stage));
  }
  CHECK_FALSE(encoder.lines.empty());
  CHECK(file_names_in(work.path) ==
        std::vector<std::string>{"prepared", "scene.stgs", "trained.stgs"});

  const ScenePtr opened = make_scene();
  REQUIRE(stgs_scene_open(opened.get(), (work / "scene.stgs").c_str()) == STGS_OK);
  const stgs_view view = start_view(opened.get());
  const auto pixels = render_rgba8(cpu_renderer().get(), opened.get(), 0.03, view);
  CHECK(view.width == 120);
  std::size_t opaque = 0;
  for (std::size_t i = 3; i < pixels.size(); i += 4) opaque += pixels[i] > 127 ? 1 : 0;
  CHECK(opaque > pixels.size() / 8);
}

#ifdef STGS_HAS_PREPARE
TEST_CASE("cancelled preparation leaves no files", "[sdk]") {
  const TemporaryFolder work;
  ObservedEncoder encoder;
  const std::string stage = GENERATE("frames", "motion", "depth range");
  encoder.should_cancel = [&](const stgs_encoder_progress& progress) {
    return progress.stage == stage;
  };
  stgs_prepare_settings settings;
  REQUIRE(stgs_prepare_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.end_frame = 2;
  settings.scale = 0.25;
  auto report = empty_output<stgs_prepare_report>();
  report.frames = 77;
  CHECK(stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop", (work / "out").c_str(),
                             &settings, &report) == STGS_ERROR_CANCELLED);
  CHECK(encoder.error().result == STGS_ERROR_CANCELLED);
  CHECK(encoder.stages.back() == stage);
  CHECK(encoder.calls_after_cancel == 0);
  CHECK(report.frames == 77);
  CHECK(file_names_in(work.path).empty());
}
#endif

TEST_CASE("cancelled training leaves a checkpoint and resumes to identical bytes", "[sdk]") {
  const PreparedCapture prepared;
  stgs_train_settings settings = short_training();
  const std::string reference = prepared.path("reference.stgs");
  const std::string resumed = prepared.path("resumed.stgs");
  const std::string checkpoint = prepared.path("run.ckpt");
  {
    const ObservedEncoder encoder;
    REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), reference.c_str(),
                               &settings, nullptr) == STGS_OK);
  }
  settings.checkpoint = checkpoint.c_str();
  settings.checkpoint_interval = 25;
  ObservedEncoder encoder;
  // Cancels once there is a checkpoint to resume from.
  encoder.should_cancel = [&](const stgs_encoder_progress& progress) {
    return progress.stage == std::string("train") && fs::exists(checkpoint);
  };
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), resumed.c_str(), &settings,
                             nullptr) == STGS_ERROR_CANCELLED);
  CHECK(std::string(encoder.error().message).find(checkpoint) != std::string::npos);
  CHECK(encoder.calls_after_cancel == 0);
  CHECK_FALSE(fs::exists(resumed));
  REQUIRE(fs::exists(checkpoint));
  const auto cancelled_at = encoder.last_training.iteration;
  CHECK(cancelled_at >= 25);
  CHECK(cancelled_at < 60);

  // The number of threads does not change the result.
  ObservedEncoder other(2);
  settings.resume = checkpoint.c_str();
  auto report = empty_output<stgs_train_report>();
  REQUIRE(stgs_encoder_train(other.get(), prepared.folder().c_str(), resumed.c_str(), &settings,
                             &report) == STGS_OK);
  CHECK(report.iterations == 60);
  CHECK(other.is_monotonic);
  CHECK(bytes_of(resumed) == bytes_of(reference));
  // The callback cancelled only one call; the encoder can still be used.
  encoder.should_cancel = nullptr;
  const std::string again = prepared.path("again.stgs");
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), again.c_str(), &settings,
                             nullptr) == STGS_OK);
  CHECK(bytes_of(again) == bytes_of(reference));
}

TEST_CASE("another thread cancels an encoder permanently", "[sdk]") {
  const PreparedCapture prepared;
  ObservedEncoder encoder;
  std::atomic<bool> training{false};
  encoder.should_cancel = [&](const stgs_encoder_progress& progress) {
    if (progress.stage == std::string("train")) {
      training = true;
      training.notify_one();
    }
    return false;
  };
  // Takes minutes unless it is cancelled.
  const stgs_train_settings settings = short_training(100000);
  const std::string scene = prepared.path("scene.stgs");
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
  CHECK(pack_one(encoder, scene, prepared.path("packed.stgs")) == STGS_ERROR_CANCELLED);
  CHECK(std::string(encoder.error().message).find("another") != std::string::npos);
  stgs_encoder_cancel(nullptr);
}

TEST_CASE("cancelled packing leaves the existing output", "[sdk]") {
  const PreparedCapture prepared;
  ObservedEncoder encoder;
  const stgs_train_settings training = short_training(10);
  const std::string scene = prepared.path("scene.stgs"), output = prepared.path("packed.stgs");
  REQUIRE(stgs_encoder_train(encoder.get(), prepared.folder().c_str(), scene.c_str(), &training,
                             nullptr) == STGS_OK);
  std::ofstream(output) << "before";
  encoder.should_cancel = [](const stgs_encoder_progress& progress) {
    return progress.stage == std::string("pack") && progress.done >= 0.8;
  };
  CHECK(pack_one(encoder, scene, output) == STGS_ERROR_CANCELLED);
  CHECK(encoder.stages.back() == "pack");
  const std::string before = "before";
  CHECK(bytes_of(output) == Bytes(before.begin(), before.end()));
  encoder.should_cancel = nullptr;
  CHECK(pack_one(encoder, scene, output) == STGS_OK);
  CHECK(fs::file_size(output) > 100);

  // The output must not overwrite the input, even under another spelling of its path.
  CHECK(pack_one(encoder, scene, prepared.path("./scene.stgs")) == STGS_ERROR_ARGUMENT);
  CHECK(pack_one(encoder, prepared.path("none.stgs"), output) == STGS_ERROR_IO);
  stgs_pack_settings settings = pack_settings();
  settings.target_kbps = 0.01;
  CHECK(pack_one(encoder, scene, output, &settings) == STGS_ERROR_ARGUMENT);
  settings.profile = STGS_PROFILE_NEAR_LOSSLESS;
  CHECK(pack_one(encoder, scene, output, &settings) == STGS_ERROR_ARGUMENT);
  settings.target_kbps = 0;
  auto report = empty_output<stgs_pack_report>();
  CHECK(pack_one(encoder, scene, output, &settings, &report) == STGS_OK);
  CHECK(report.quality == 0);
  CHECK(report.images_psnr > 60);
  settings = pack_settings();
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

// Returns the number of threads in the thread pools of this process.
int pool_threads() {
  int count = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm"), name);
    count += name == "stgs-pool" ? 1 : 0;
  }
  return count;
}

TEST_CASE("an encoder limits its threads", "[sdk]") {
  const PreparedCapture prepared;
  const int before = pool_threads();
  const auto most_threads = [before](std::uint32_t limit, const auto& call) {
    int threads = 0;
    ObservedEncoder encoder(limit);
    encoder.should_cancel = [&](const stgs_encoder_progress&) {
      threads = std::max(threads, 1 + pool_threads() - before);
      return false;
    };
    REQUIRE(call(encoder.get()) == STGS_OK);
    return threads;
  };
  const stgs_train_settings settings = short_training(5);
  const auto train = [&](stgs_encoder* encoder) {
    return stgs_encoder_train(encoder, prepared.folder().c_str(),
                              prepared.path("scene.stgs").c_str(), &settings, nullptr);
  };
  CHECK(most_threads(1, train) == 1);
  CHECK(most_threads(3, train) == 3);
#ifdef STGS_HAS_PREPARE
  stgs_prepare_settings preparing;
  REQUIRE(stgs_prepare_settings_defaults(&preparing, sizeof preparing) == STGS_OK);
  preparing.end_frame = 1;
  preparing.scale = 0.1;
  CHECK(most_threads(1, [&](stgs_encoder* encoder) {
          return stgs_encoder_prepare(encoder, STGS_TEST_DATA "/workshop",
                                      prepared.path("out").c_str(), &preparing, nullptr);
        }) == 1);
#endif
  CHECK(pool_threads() == before);
}

TEST_CASE("one of four encoders writes an output at a time, the others report it", "[sdk]") {
  const PreparedCapture prepared;
  const ObservedEncoder trainer;
  const stgs_train_settings settings = short_training(5);
  const std::string trained = prepared.path("trained.stgs");
  REQUIRE(stgs_encoder_train(trainer.get(), prepared.folder().c_str(), trained.c_str(), &settings,
                             nullptr) == STGS_OK);
  const std::vector<std::string> before = file_names_in(prepared.path("."));
  const std::string output = prepared.path("packed.stgs");
  std::atomic<int> packed{0}, refused{0};
  std::vector<std::thread> threads;
  for (int k = 0; k < 4; ++k) {
    threads.emplace_back([&] {
      const ObservedEncoder encoder;
      for (int run = 0; run < 5; ++run) {
        const stgs_result result =
            stgs_encoder_pack(encoder.get(), trained.c_str(), output.c_str(), nullptr, nullptr);
        packed += result == STGS_OK;
        refused += result == STGS_ERROR_ARGUMENT &&
                   std::string(encoder.error().message).find("is writing it") != std::string::npos;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  CHECK(packed > 0);
  CHECK(packed + refused == 20);
  const ScenePtr opened = make_scene();
  CHECK(stgs_scene_open(opened.get(), output.c_str()) == STGS_OK);
  CHECK(file_names_in(prepared.path(".")).size() == before.size() + 1);  // no temporary file
}

}  // namespace stgs::testing
