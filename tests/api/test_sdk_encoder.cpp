// SPDX-License-Identifier: Apache-2.0
// The C interface of the encoder: from a capture to a scene that is drawn, stopped at any stage,
// resumed, and with settings that are none.
#include <sys/stat.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <thread>

#include "sdk_fixture.h"
#include "stgs/encoder/train.h"
#include "stgs/stgs_encoder.h"
#include "struct_sizes.h"
#include "synthetic_capture.h"

namespace stgs::testing {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<char>;

// A folder of the test's own, removed with it.
class WorkFolder {
 public:
  WorkFolder() : path_(fs::temp_directory_path() / fmt::format("stgs-encoder-{}", ::getpid())) {
    fs::remove_all(path_);
    fs::create_directories(path_);
  }
  ~WorkFolder() { fs::remove_all(path_); }
  std::string at(const std::string& name) const { return (path_ / name).string(); }
  // What is in it, hidden files too.
  std::vector<std::string> names() const {
    std::vector<std::string> out;
    for (const auto& entry : fs::directory_iterator(path_)) {
      out.push_back(entry.path().filename().string());
    }
    std::sort(out.begin(), out.end());
    return out;
  }

 private:
  fs::path path_;
};

Bytes bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

struct DestroyEncoder {
  void operator()(stgs_encoder* encoder) const { stgs_encoder_destroy(encoder); }
};

// An encoder that notes what it is told, and asks `stop` whether to.
class Watched {
 public:
  explicit Watched(std::uint32_t threads = 0) {
    stgs_encoder_settings settings;
    REQUIRE(stgs_encoder_settings_defaults(&settings, sizeof settings) == STGS_OK);
    settings.threads = threads;
    settings.progress_user = settings.log_user = this;
    settings.progress = [](void* user, const stgs_encoder_progress* progress) -> std::int32_t {
      return static_cast<Watched*>(user)->on_progress(*progress);
    };
    settings.log = [](void* user, stgs_log_level, const char* message) {
      static_cast<Watched*>(user)->lines.emplace_back(message);
    };
    stgs_encoder* made = nullptr;
    REQUIRE(stgs_encoder_create(&settings, &made) == STGS_OK);
    encoder_.reset(made);
  }

  stgs_encoder* get() const { return encoder_.get(); }
  stgs_error error() const {
    stgs_error error{};
    error.struct_size = sizeof error;
    REQUIRE(stgs_encoder_error(get(), &error) == STGS_OK);
    return error;
  }
  bool saw(const std::string& stage) const {
    return std::find(stages.begin(), stages.end(), stage) != stages.end();
  }

  std::function<bool(const stgs_encoder_progress&)> stop;
  std::vector<std::string> stages, lines;
  int calls_after_stop = 0;
  bool monotone = true;
  stgs_encoder_progress last_training{};

 private:
  std::int32_t on_progress(const stgs_encoder_progress& progress) {
    if (stopped_) ++calls_after_stop;
    if (stages.empty() || stages.back() != progress.stage) {
      // No stage comes twice: what is done can be shown as one bar after another.
      monotone = monotone && !saw(progress.stage);
      stages.emplace_back(progress.stage);
      done_ = 0;
    }
    monotone = monotone && progress.done >= done_ && progress.done <= 1;
    done_ = progress.done;
    if (stages.back() == "train") last_training = progress;
    stopped_ = stop && stop(progress);
    return stopped_ ? 1 : 0;
  }

  std::unique_ptr<stgs_encoder, DestroyEncoder> encoder_;
  double done_ = 0;
  bool stopped_ = false;
};

// A prepared capture that needs no OpenCV.
class Prepared {
 public:
  Prepared() : synthetic_(fmt::format("sdk_encoder_{}", ::getpid())) {}
  std::string folder() const { return synthetic_.capture.folder; }
  std::string at(const std::string& name) const { return folder() + "/" + name; }

 private:
  test::SyntheticCapture synthetic_;
};

stgs_train_settings short_training(std::uint32_t iterations = 60) {
  stgs_train_settings settings;
  REQUIRE(stgs_train_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.preset = STGS_PRESET_FAST;
  settings.backend = STGS_BACKEND_CPU;
  settings.iterations = iterations;
  settings.max_primitives = 600;
  return settings;
}
stgs_pack_settings packing() {
  stgs_pack_settings settings;
  REQUIRE(stgs_pack_settings_defaults(&settings, sizeof settings) == STGS_OK);
  return settings;
}
template <typename Report>
Report empty_report() {
  Report report{};
  report.struct_size = sizeof report;
  return report;
}

stgs_result pack_one(const Watched& encoder, const std::string& scene, const std::string& output,
                     const stgs_pack_settings* settings = nullptr,
                     stgs_pack_report* report = nullptr) {
  const char* const scenes[] = {scene.c_str()};
  return stgs_encoder_pack(encoder.get(), scenes, 1, output.c_str(), settings, report);
}

}  // namespace

TEST_CASE("a capture is prepared, trained, packed, opened and drawn", "[sdk]") {
  const WorkFolder work;
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
  const std::string folder = work.at("prepared"), scene = work.at("trained.stgs");
  const stgs_result result = stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop",
                                                  folder.c_str(), &preparing, longer.get());
  INFO(encoder.error().message);
#ifndef STGS_HAS_PREPARE
  CHECK(result == STGS_ERROR_NOT_BUILT);
  CHECK(std::string(encoder.error().message).find("OpenCV") != std::string::npos);
  CHECK(work.names().empty());
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
  CHECK(trained.held_out_pictures == 4);
  CHECK(encoder.last_training.iteration == 20);
  CHECK(encoder.last_training.iterations == 20);
  CHECK(encoder.last_training.primitives == trained.primitives);
  CHECK(encoder.last_training.loss == trained.loss);
  CHECK(encoder.last_training.held_out_psnr == trained.held_out_psnr);
  CHECK(encoder.last_training.done == 1);

  stgs_pack_settings settings = packing();
  settings.against = folder.c_str();
  auto packed = empty_report<stgs_pack_report>();
  REQUIRE(pack_one(encoder, scene, work.at("scene.stgs"), &settings, &packed) == STGS_OK);
  CHECK(packed.primitives + packed.dropped == trained.primitives);
  CHECK(packed.bytes_in == trained.bytes);
  CHECK(packed.bytes_out == fs::file_size(work.at("scene.stgs")));
  CHECK(packed.bytes_out < packed.bytes_in);
  CHECK(packed.quality == settings.quality);
  CHECK(packed.pictures_psnr > 25);
  CHECK(packed.held_out_before == Approx(trained.held_out_psnr).margin(1));
  CHECK(packed.held_out_after == Approx(packed.held_out_before).margin(1));
  CHECK(encoder.monotone);
  for (const char* stage : {"frames", "depth range", "velocities", "load", "train", "pack"}) {
    INFO(stage);
    CHECK(encoder.saw(stage));
  }
  CHECK_FALSE(encoder.lines.empty());
  CHECK(work.names() == std::vector<std::string>{"prepared", "scene.stgs", "trained.stgs"});

  const ScenePtr opened = make_scene();
  REQUIRE(stgs_scene_open(opened.get(), work.at("scene.stgs").c_str()) == STGS_OK);
  const stgs_view view = start_view(opened.get());
  const auto pixels = draw_rgba8(cpu_renderer().get(), opened.get(), 0.03, view);
  CHECK(view.width == 120);
  std::size_t opaque = 0;
  for (std::size_t i = 3; i < pixels.size(); i += 4) opaque += pixels[i] > 127 ? 1 : 0;
  CHECK(opaque > pixels.size() / 8);
}

#ifdef STGS_HAS_PREPARE
TEST_CASE("preparing that is stopped leaves nothing", "[sdk]") {
  const WorkFolder work;
  Watched encoder;
  const std::string at = GENERATE("frames", "motion", "depth range");
  encoder.stop = [&](const stgs_encoder_progress& progress) { return progress.stage == at; };
  stgs_prepare_settings settings;
  REQUIRE(stgs_prepare_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.end_frame = 2;
  settings.scale = 0.25;
  auto report = empty_report<stgs_prepare_report>();
  report.frames = 77;
  CHECK(stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop", work.at("out").c_str(),
                             &settings, &report) == STGS_ERROR_CANCELLED);
  CHECK(encoder.error().result == STGS_ERROR_CANCELLED);
  CHECK(encoder.stages.back() == at);
  CHECK(encoder.calls_after_stop == 0);
  CHECK(report.frames == 77);
  CHECK(work.names().empty());
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
  settings.sound = "sound.ogg";
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

namespace {

// The message of a call that is refused for its settings.
template <typename Settings, typename Call>
std::string refusal(const Watched& encoder, Settings settings,
                    const std::function<void(Settings&)>& change, const Call& call,
                    stgs_result expected = STGS_ERROR_ARGUMENT) {
  change(settings);
  CHECK(call(settings) == expected);
  return encoder.error().message;
}

}  // namespace

TEST_CASE("settings of training that are none are named, with what is possible", "[sdk]") {
  const Prepared prepared;
  const Watched encoder;
  using Settings = stgs_train_settings;
  const std::string scene = prepared.at("scene.stgs");
  const auto call = [&](const Settings& settings) {
    const stgs_result refused = stgs_encoder_train(encoder.get(), prepared.folder().c_str(),
                                                   scene.c_str(), &settings, nullptr);
    CHECK(stgs_encoder_check_training(encoder.get(), &settings) == refused);
    return refused;
  };
  struct Case {
    std::string field, possible;
    std::function<void(Settings&)> change;
  };
  const stgs_parameter unknown{"no_such_rate", "1"}, no_number{"lr_scale", "fast"},
      null{"a", nullptr};
  const std::vector<Case> cases = {
      {"preset is 3", "0 to 2", [](Settings& s) { s.preset = 3; }},
      {"backend is 9", "0 to 2", [](Settings& s) { s.backend = 9; }},
      {"iterations is 4294967295", "0 (the preset's) or 1 to 100000000",
       [](Settings& s) { s.iterations = UINT32_MAX; }},
      {"max_primitives is", "1 to 200000000", [](Settings& s) { s.max_primitives = 300000000; }},
      {"max_seconds is nan", "1 to 100000000", [](Settings& s) { s.max_seconds = std::nan(""); }},
      {"max_seconds is -1", "0 (no limit)", [](Settings& s) { s.max_seconds = -1; }},
      {"first_frame is 3", "greater", [](Settings& s) { s.first_frame = s.end_frame = 3; }},
      {"checkpoint_interval is 0", "1 to", [](Settings& s) { s.checkpoint_interval = 0; }},
      {"held_out_measures is 2000000", "to 1000000",
       [](Settings& s) { s.held_out_measures = 2000000; }},
      {"parameters is NULL", "as many", [](Settings& s) { s.parameter_count = 1; }},
      {"parameters[0]", "NULL", [&](Settings& s) { s.parameters = &null, s.parameter_count = 1; }},
      {"no_such_rate", "known: iterations",
       [&](Settings& s) { s.parameters = &unknown, s.parameter_count = 1; }},
      {"'fast' is not a value for lr_scale", "number",
       [&](Settings& s) { s.parameters = &no_number, s.parameter_count = 1; }},
  };
  for (const Case& one : cases) {
    const std::string told = refusal<Settings>(encoder, short_training(), one.change, call);
    INFO(told);
    CHECK(told.find(one.field) != std::string::npos);
    CHECK(told.find(one.possible) != std::string::npos);
  }
  CHECK(encoder.stages.empty());
  Settings wrong_size = short_training();
  wrong_size.struct_size = 0;
  CHECK(call(wrong_size) == STGS_ERROR_STRUCT_SIZE);
  CHECK(stgs_encoder_check_training(encoder.get(), nullptr) == STGS_OK);
}

TEST_CASE("settings of preparing and packing that are none are named", "[sdk]") {
  const WorkFolder work;
  const Watched encoder;
  using Preparing = stgs_prepare_settings;
  Preparing preparing;
  REQUIRE(stgs_prepare_settings_defaults(&preparing, sizeof preparing) == STGS_OK);
  const auto prepare = [&](const Preparing& settings) {
    return stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop", work.at("out").c_str(),
                                &settings, nullptr);
  };
  const std::pair<std::string, std::function<void(Preparing&)>> of_prepare[] = {
      {"layout is 7; it can be 0 to 6", [](Preparing& s) { s.layout = 7; }},
      {"first_frame is -1", [](Preparing& s) { s.first_frame = -1; }},
      {"end_frame -2", [](Preparing& s) { s.end_frame = -2; }},
      {"scale is 0; it can be 0.01 to 1", [](Preparing& s) { s.scale = 0; }},
      {"default_test_cameras is 2", [](Preparing& s) { s.default_test_cameras = 2; }},
      {"default_test_cameras is 1", [](Preparing& s) { s.test_camera_count = 1; }},
      {"test_cameras is NULL",
       [](Preparing& s) { s.default_test_cameras = 0, s.test_camera_count = 1; }},
      {"fps is -30", [](Preparing& s) { s.fps = -30; }},
      {"separate_motion is -1", [](Preparing& s) { s.separate_motion = -1; }},
      {"max_static_points is", [](Preparing& s) { s.max_static_points = UINT32_MAX; }},
      {"overwrite is 5; it can be 0 or 1", [](Preparing& s) { s.overwrite = 5; }},
  };
  for (const auto& [expected, change] : of_prepare) {
    const std::string told = refusal<Preparing>(encoder, preparing, change, prepare);
    INFO(told);
    CHECK(told.find(expected) != std::string::npos);
  }
  using Packing = stgs_pack_settings;
  const auto pack = [&](const Packing& settings) {
    return pack_one(encoder, work.at("none.stgs"), work.at("out.stgs"), &settings);
  };
  const std::pair<std::string, std::function<void(Packing&)>> of_pack[] = {
      {"profile is 2; it can be 0 to 1", [](Packing& s) { s.profile = 2; }},
      {"tiers is 17; it can be 1 to 16", [](Packing& s) { s.tiers = 17; }},
      {"quality is 101; it can be 0 to 100", [](Packing& s) { s.quality = 101; }},
      {"target_kbps is -8; it can be 0 (none) or 0.001", [](Packing& s) { s.target_kbps = -8; }},
      {"max_error is inf", [](Packing& s) { s.max_error = HUGE_VAL; }},
      {"chunk_seconds is 4000", [](Packing& s) { s.chunk_seconds = 4000; }},
      {"metres_per_unit is -1", [](Packing& s) { s.metres_per_unit = -1; }},
      {"up is nan", [](Packing& s) { s.up[1] = std::nanf(""); }},
      {"sound_begin is", [](Packing& s) { s.sound_begin = 1e9; }},
  };
  for (const auto& [expected, change] : of_pack) {
    const std::string told = refusal<Packing>(encoder, packing(), change, pack);
    INFO(told);
    CHECK(told.find(expected) != std::string::npos);
  }
  CHECK(work.names().empty());
}

TEST_CASE("backends that cannot train are told apart from those without a device", "[sdk]") {
  const Prepared prepared;
  const Watched encoder;
  stgs_train_settings settings = short_training();
  settings.backend = STGS_BACKEND_VULKAN;
  CHECK(stgs_encoder_check_training(encoder.get(), &settings) == STGS_ERROR_NOT_BUILT);
  CHECK(std::string(encoder.error().message).find("STGS_BACKEND_VULKAN") != std::string::npos);
  settings.backend = STGS_BACKEND_CUDA;
  const auto built = encoder::train_backends();
  const bool has_cuda = std::find(built.begin(), built.end(), "cuda") != built.end();
  const std::string scene = prepared.at("scene.stgs");
  const stgs_result result = stgs_encoder_train(encoder.get(), prepared.folder().c_str(),
                                                scene.c_str(), &settings, nullptr);
  INFO(encoder.error().message);
  if (has_cuda) {
    CHECK((result == STGS_OK || result == STGS_ERROR_UNSUPPORTED));
  } else {
    CHECK(result == STGS_ERROR_NOT_BUILT);
    CHECK(std::string(encoder.error().message).find("cuda") != std::string::npos);
    CHECK_FALSE(fs::exists(scene));
  }
}

TEST_CASE("places that are missing, taken or the same are told before long work", "[sdk]") {
  const Prepared prepared;
  const Watched encoder;
  stgs_train_settings settings = short_training(10);
  const std::string scene = prepared.at("scene.stgs"), none = prepared.at("none");
  const auto train = [&](const std::string& folder, const std::string& output) {
    return stgs_encoder_train(encoder.get(), folder.c_str(), output.c_str(), &settings, nullptr);
  };
  CHECK(train(none, scene) == STGS_ERROR_IO);
  CHECK(std::string(encoder.error().message).find(none) != std::string::npos);
  CHECK(train(prepared.folder(), none + "/scene.stgs") == STGS_ERROR_IO);
  CHECK(std::string(encoder.error().message).find("does not exist") != std::string::npos);
  settings.checkpoint = scene.c_str();
  CHECK(train(prepared.folder(), prepared.at("frames/../scene.stgs")) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(encoder.error().message).find("checkpoint") != std::string::npos);
  settings.checkpoint = nullptr;
  settings.resume = none.c_str();
  CHECK(train(prepared.folder(), scene) == STGS_ERROR_IO);
  CHECK(stgs_encoder_check_training(encoder.get(), &settings) == STGS_ERROR_IO);
  settings.resume = nullptr;
  settings.first_frame = 4;
  settings.end_frame = 20;
  CHECK(train(prepared.folder(), scene) == STGS_ERROR_ARGUMENT);
  CHECK(encoder.stages.empty());
  CHECK_FALSE(fs::exists(scene));
#ifdef STGS_HAS_PREPARE
  CHECK(stgs_encoder_prepare(encoder.get(), none.c_str(), prepared.at("out").c_str(), nullptr,
                             nullptr) == STGS_ERROR_IO);
#endif
  CHECK(stgs_encoder_train(encoder.get(), nullptr, scene.c_str(), &settings, nullptr) ==
        STGS_ERROR_ARGUMENT);
  CHECK(stgs_encoder_pack(encoder.get(), nullptr, 1, scene.c_str(), nullptr, nullptr) ==
        STGS_ERROR_ARGUMENT);
  CHECK(std::string(encoder.error().message).find("scenes") != std::string::npos);
}

TEST_CASE("a pipe is no scene to pack, and is not waited for", "[sdk]") {
  const WorkFolder work;
  const Watched encoder;
  const std::string pipe = work.at("pipe.stgs");
  REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
  ::alarm(60);  // ends who waits for a writer
  CHECK(pack_one(encoder, pipe, work.at("packed.stgs")) == STGS_ERROR_IO);
  ::alarm(0);
  CHECK(encoder.error().message == pipe + ": not a regular file");
  CHECK(work.names() == std::vector<std::string>{"pipe.stgs"});
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

TEST_CASE("an encoder is made with settings that make sense", "[sdk]") {
  stgs_encoder* encoder = reinterpret_cast<stgs_encoder*>(1);
  stgs_encoder_settings settings;
  CHECK(stgs_encoder_settings_defaults(&settings, sizeof settings - 1) == STGS_ERROR_STRUCT_SIZE);
  CHECK(stgs_encoder_settings_defaults(nullptr, sizeof settings) == STGS_ERROR_ARGUMENT);
  REQUIRE(stgs_encoder_settings_defaults(&settings, sizeof settings) == STGS_OK);
  settings.threads = 1025;
  CHECK(stgs_encoder_create(&settings, &encoder) == STGS_ERROR_ARGUMENT);
  CHECK(encoder == nullptr);
  settings.threads = 1;
  settings.struct_size = 8;
  CHECK(stgs_encoder_create(&settings, &encoder) == STGS_ERROR_STRUCT_SIZE);
  CHECK(stgs_encoder_create(nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  REQUIRE(stgs_encoder_create(nullptr, &encoder) == STGS_OK);
  stgs_error error{};
  error.struct_size = sizeof error;
  REQUIRE(stgs_encoder_error(encoder, &error) == STGS_OK);
  CHECK(error.result == STGS_OK);
  stgs_encoder_destroy(encoder);
  stgs_encoder_destroy(nullptr);
  CHECK(stgs_encoder_error(nullptr, &error) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_encoder_pack(nullptr, nullptr, 0, nullptr, nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(stgs_result_name(STGS_ERROR_CANCELLED)) == "STGS_ERROR_CANCELLED");
}

}  // namespace stgs::testing
