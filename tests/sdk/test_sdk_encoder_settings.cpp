// SPDX-License-Identifier: Apache-2.0
// Errors of the encoder of the C API: invalid settings, unavailable backends and bad paths.
#include <sys/stat.h>

#include <cmath>
#include <functional>
#include <limits>

#include "sdk_encoder_fixture.h"
#include "stgs/encoder/train.h"

namespace stgs::testing {
namespace {

// Returns the message of a call that rejects the changed settings.
template <typename Settings, typename Call>
std::string rejection_message(const ObservedEncoder& encoder, Settings settings,
                              const std::function<void(Settings&)>& change, const Call& call,
                              stgs_result expected = STGS_ERROR_ARGUMENT) {
  change(settings);
  CHECK(call(settings) == expected);
  return encoder.error().message;
}

}  // namespace

TEST_CASE("invalid training settings are rejected with their name and range", "[sdk]") {
  const PreparedCapture prepared;
  const ObservedEncoder encoder;
  using Settings = stgs_train_settings;
  const std::string scene = prepared.path("scene.stgs");
  const auto call = [&](const Settings& settings) {
    const stgs_result result = stgs_encoder_train(encoder.get(), prepared.folder().c_str(),
                                                  scene.c_str(), &settings, nullptr);
    CHECK(stgs_encoder_check_training(encoder.get(), &settings) == result);
    return result;
  };
  struct Case {
    std::string field, range;
    std::function<void(Settings&)> change;
  };
  const stgs_parameter unknown{"no_such_rate", "1"}, no_number{"lr_scale", "fast"},
      null{"a", nullptr};
  const std::vector<Case> cases = {
      {"preset is 3", "0 to 2", [](Settings& s) { s.preset = 3; }},
      {"backend is 9", "0 to 2", [](Settings& s) { s.backend = 9; }},
      {"iterations is 4294967295", "0 for the value of the preset, or 1 to 100000000",
       [](Settings& s) { s.iterations = UINT32_MAX; }},
      {"max_primitives is", "1 to 200000000", [](Settings& s) { s.max_primitives = 300000000; }},
      {"max_seconds is nan", "1 to 100000000", [](Settings& s) { s.max_seconds = std::nan(""); }},
      {"max_seconds is -1", "0 for no limit", [](Settings& s) { s.max_seconds = -1; }},
      {"checkpoint_interval is 0", "1 to", [](Settings& s) { s.checkpoint_interval = 0; }},
      {"held_out_evaluations is 2000000", "to 1000000",
       [](Settings& s) { s.held_out_evaluations = 2000000; }},
      {"allow_outside is 2", "0 or 1", [](Settings& s) { s.allow_outside = 2; }},
      {"parameters is NULL", "parameter_count is 1", [](Settings& s) { s.parameter_count = 1; }},
      {"parameters[0]", "NULL", [&](Settings& s) { s.parameters = &null, s.parameter_count = 1; }},
      {"no_such_rate", "expected one of: iterations",
       [&](Settings& s) { s.parameters = &unknown, s.parameter_count = 1; }},
      {"--set lr_scale=fast: invalid value", "number",
       [&](Settings& s) { s.parameters = &no_number, s.parameter_count = 1; }},
  };
  for (const Case& one : cases) {
    const std::string message =
        rejection_message<Settings>(encoder, short_training(), one.change, call);
    INFO(message);
    CHECK(message.find(one.field) != std::string::npos);
    CHECK(message.find(one.range) != std::string::npos);
  }
  CHECK(encoder.stages.empty());
  Settings wrong_size = short_training();
  wrong_size.struct_size = 0;
  CHECK(call(wrong_size) == STGS_ERROR_STRUCT_SIZE);
  CHECK(stgs_encoder_check_training(encoder.get(), nullptr) == STGS_OK);
}

TEST_CASE("invalid prepare and pack settings are rejected with their name and range", "[sdk]") {
  const TemporaryFolder work;
  const ObservedEncoder encoder;
  using Preparing = stgs_prepare_settings;
  Preparing preparing;
  REQUIRE(stgs_prepare_settings_defaults(&preparing, sizeof preparing) == STGS_OK);
  const auto prepare = [&](const Preparing& settings) {
    return stgs_encoder_prepare(encoder.get(), STGS_TEST_DATA "/workshop", (work / "out").c_str(),
                                &settings, nullptr);
  };
  const std::pair<std::string, std::function<void(Preparing&)>> prepare_cases[] = {
      {"layout is 7 (expected 0 to 6)", [](Preparing& s) { s.layout = 7; }},
      {"first_frame is -1", [](Preparing& s) { s.first_frame = -1; }},
      {"end_frame is -2", [](Preparing& s) { s.end_frame = -2; }},
      {"scale is 0 (expected 0.01 to 1)", [](Preparing& s) { s.scale = 0; }},
      {"default_test_cameras is 2", [](Preparing& s) { s.default_test_cameras = 2; }},
      {"default_test_cameras is 1", [](Preparing& s) { s.test_camera_count = 1; }},
      {"test_cameras is NULL",
       [](Preparing& s) { s.default_test_cameras = 0, s.test_camera_count = 1; }},
      {"fps is -30", [](Preparing& s) { s.fps = -30; }},
      {"separate_motion is -1", [](Preparing& s) { s.separate_motion = -1; }},
      {"max_static_points is", [](Preparing& s) { s.max_static_points = UINT32_MAX; }},
      {"overwrite is 5 (expected 0 or 1)", [](Preparing& s) { s.overwrite = 5; }},
      {"allow_outside is 2 (expected 0 or 1)", [](Preparing& s) { s.allow_outside = 2; }},
      {"trust_calibration is 2 (expected 0 or 1)", [](Preparing& s) { s.trust_calibration = 2; }},
      {"backend is 9 (expected 0 to 2)", [](Preparing& s) { s.backend = 9; }},
  };
  for (const auto& [expected, change] : prepare_cases) {
    const std::string message = rejection_message<Preparing>(encoder, preparing, change, prepare);
    INFO(message);
    CHECK(message.find(expected) != std::string::npos);
  }
  using Packing = stgs_pack_settings;
  const auto pack = [&](const Packing& settings) {
    return pack_one(encoder, work / "none.stgs", work / "out.stgs", &settings);
  };
  const std::pair<std::string, std::function<void(Packing&)>> pack_cases[] = {
      {"profile is 3 (expected 0 to 2)", [](Packing& s) { s.profile = 3; }},
      {"tiers is 17 (expected 0 for an automatic choice, or 1 to 16)",
       [](Packing& s) { s.tiers = 17; }},
      {"or 0.1 to 100)", [](Packing& s) { s.quality = 101; }},
      {"target_size is -1 (expected 0 for no limit", [](Packing& s) { s.target_size = -1; }},
      {"target_kbps is -8 (expected 0 for no limit, or 0.001",
       [](Packing& s) { s.target_kbps = -8; }},
      {"max_error is inf", [](Packing& s) { s.max_error = HUGE_VAL; }},
      {"chunk_seconds is 4000", [](Packing& s) { s.chunk_seconds = 4000; }},
      {"metres_per_unit is -1", [](Packing& s) { s.metres_per_unit = -1; }},
      {"up is nan", [](Packing& s) { s.up[1] = std::nanf(""); }},
      {"audio_begin is", [](Packing& s) { s.audio_begin = 1e9; }},
  };
  for (const auto& [expected, change] : pack_cases) {
    const std::string message = rejection_message<Packing>(encoder, pack_settings(), change, pack);
    INFO(message);
    CHECK(message.find(expected) != std::string::npos);
  }
  CHECK(file_names_in(work.path).empty());
}

TEST_CASE("a backend that cannot train and one without a device give different errors", "[sdk]") {
  const PreparedCapture prepared;
  const ObservedEncoder encoder;
  stgs_train_settings settings = short_training();
  settings.backend = STGS_BACKEND_VULKAN;
  CHECK(stgs_encoder_check_training(encoder.get(), &settings) == STGS_ERROR_NOT_BUILT);
  CHECK(std::string(encoder.error().message).find("STGS_BACKEND_VULKAN") != std::string::npos);
  settings.backend = STGS_BACKEND_CUDA;
  const auto built = encoder::train_backends();
  const bool has_cuda = std::find(built.begin(), built.end(), "cuda") != built.end();
  const std::string scene = prepared.path("scene.stgs");
  const stgs_result result = stgs_encoder_train(encoder.get(), prepared.folder().c_str(),
                                                scene.c_str(), &settings, nullptr);
  INFO(encoder.error().message);
  if (has_cuda) {
    CHECK((result == STGS_OK || result == STGS_ERROR_UNSUPPORTED));
  } else {
    CHECK(result == STGS_ERROR_NOT_BUILT);
    CHECK(std::string(encoder.error().message).find("CUDA") != std::string::npos);
    CHECK_FALSE(fs::exists(scene));
  }
}

TEST_CASE("missing and conflicting paths are rejected before training starts", "[sdk]") {
  const PreparedCapture prepared;
  const ObservedEncoder encoder;
  stgs_train_settings settings = short_training(10);
  const std::string scene = prepared.path("scene.stgs"), none = prepared.path("none");
  const auto train = [&](const std::string& folder, const std::string& output) {
    return stgs_encoder_train(encoder.get(), folder.c_str(), output.c_str(), &settings, nullptr);
  };
  CHECK(train(none, scene) == STGS_ERROR_IO);
  CHECK(std::string(encoder.error().message).find(none) != std::string::npos);
  CHECK(train(prepared.folder(), none + "/scene.stgs") == STGS_ERROR_IO);
  CHECK(std::string(encoder.error().message).find("does not exist") != std::string::npos);
  settings.checkpoint = scene.c_str();
  CHECK(train(prepared.folder(), prepared.path("frames/../scene.stgs")) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(encoder.error().message).find("checkpoint") != std::string::npos);
  settings.checkpoint = nullptr;
  settings.resume = none.c_str();
  CHECK(train(prepared.folder(), scene) == STGS_ERROR_IO);
  CHECK(stgs_encoder_check_training(encoder.get(), &settings) == STGS_ERROR_IO);
  settings.resume = nullptr;
  CHECK(encoder.stages.empty());
  CHECK_FALSE(fs::exists(scene));
#ifdef STGS_HAS_PREPARE
  CHECK(stgs_encoder_prepare(encoder.get(), none.c_str(), prepared.path("out").c_str(), nullptr,
                             nullptr) == STGS_ERROR_IO);
#endif
  CHECK(stgs_encoder_train(encoder.get(), nullptr, scene.c_str(), &settings, nullptr) ==
        STGS_ERROR_ARGUMENT);
  CHECK(stgs_encoder_pack(encoder.get(), nullptr, scene.c_str(), nullptr, nullptr) ==
        STGS_ERROR_ARGUMENT);
  CHECK(std::string(encoder.error().message).find("scene") != std::string::npos);
}

TEST_CASE("links that leave a prepared capture are followed only if it is trusted", "[sdk]") {
  const test::SyntheticCapture synthetic(3, 2);
  const TemporaryFolder work;
  const encoder::PreparedCapture& capture = synthetic.capture;
  const std::string frame = capture.frame_path(capture.cameras[1], 0);
  fs::rename(frame, work / "outside");
  fs::create_symlink(work / "outside", frame);
  const ObservedEncoder encoder;
  stgs_train_settings settings = short_training();
  const auto train = [&] {
    return stgs_encoder_train(encoder.get(), capture.folder.c_str(), (work / "scene.stgs").c_str(),
                              &settings, nullptr);
  };
  CHECK(train() == STGS_ERROR_INVALID_FILE);
  CHECK(std::string(encoder.error().message).find("leads out of") != std::string::npos);
  settings.allow_outside = 1;
  CHECK(train() == STGS_OK);
}

TEST_CASE("packing rejects a pipe without waiting for a writer", "[sdk]") {
  const TemporaryFolder work;
  const ObservedEncoder encoder;
  const std::string pipe = work / "pipe.stgs";
  REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
  ::alarm(60);  // ends the test if it waits for a writer
  CHECK(pack_one(encoder, pipe, work / "packed.stgs") == STGS_ERROR_IO);
  ::alarm(0);
  CHECK(encoder.error().message == pipe + ": not a regular file");
  CHECK(file_names_in(work.path) == std::vector<std::string>{"pipe.stgs"});
}

TEST_CASE("invalid encoder settings are rejected", "[sdk]") {
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
  CHECK(stgs_encoder_pack(nullptr, nullptr, nullptr, nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(std::string(stgs_result_name(STGS_ERROR_CANCELLED)) == "STGS_ERROR_CANCELLED");
}

}  // namespace stgs::testing
