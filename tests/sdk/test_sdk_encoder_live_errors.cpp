// SPDX-License-Identifier: Apache-2.0
// Live sessions of the C API: invalid settings, cameras, images and calls.
#include <cmath>

#include "sdk_live_fixture.h"

namespace stgs::testing {
namespace {

constexpr double kNan = NAN;

// Starts a session that must fail, and returns its message.
std::string rejection_of(const FilmedCapture& filmed, const stgs_live_settings& settings,
                         stgs_result expected = STGS_ERROR_ARGUMENT) {
  const LivePtr live = make_live();
  CHECK(stgs_live_start(live.get(), filmed.recording.c_str(), &settings) == expected);
  CHECK_FALSE(fs::exists(filmed.recording));
  return message_of(live);
}

}  // namespace

TEST_CASE("invalid live settings are rejected with the name of the field", "[sdk]") {
  const FilmedCapture filmed;
  const auto check_rejected = [&](const std::function<void(stgs_live_settings&)>& change,
                                  const char* message) {
    stgs_live_settings settings = filmed.settings();
    change(settings);
    CHECK_THAT(rejection_of(filmed, settings), Catch::Contains(message));
  };
  const std::string long_text(4097, 'a');
  const stgs_parameter nameless = {nullptr, "1"};
  check_rejected([](auto& s) { s.cameras = nullptr; }, "neither of cameras and rig are set");
  check_rejected([](auto& s) { s.rig = "rig.json"; }, "both of cameras and rig are set");
  check_rejected(
      [](auto& s) {
        s.cameras = nullptr;
        s.rig = "rig.json";
      },
      "cameras is NULL, but camera_count is 3");
  check_rejected([](auto& s) { s.camera_count = 1; }, "camera_count is 1");
  check_rejected([](auto& s) { s.fps = 0; }, "fps is 0");
  check_rejected([](auto& s) { s.fps = kNan; }, "fps is nan");
  check_rejected([](auto& s) { s.scale = 1.5; }, "scale is 1.5");
  check_rejected([](auto& s) { s.latency = 0; }, "latency is 0");
  check_rejected([](auto& s) { s.start_seconds = -1; }, "start_seconds is -1");
  check_rejected([](auto& s) { s.preset = 3; }, "preset is 3");
  check_rejected([](auto& s) { s.trust_calibration = 2; }, "trust_calibration is 2");
  check_rejected([](auto& s) { s.iterations = UINT32_MAX; }, "iterations is 4294967295");
  check_rejected([](auto& s) { s.max_primitives = UINT32_MAX; }, "max_primitives is 4294967295");
  check_rejected([](auto& s) { s.threads = 1025; }, "threads is 1025");
  check_rejected([&](auto& s) { s.title = long_text.c_str(); }, "title has 4097 bytes");
  check_rejected([](auto& s) { s.parameter_count = 1; }, "parameters is NULL");
  check_rejected(
      [&](auto& s) {
        s.parameters = &nameless;
        s.parameter_count = 1;
      },
      "parameters[0]");
  stgs_live_settings vulkan = filmed.settings();
  vulkan.backend = STGS_BACKEND_VULKAN;
  rejection_of(filmed, vulkan, STGS_ERROR_NOT_BUILT);
  const LivePtr live = make_live();
  const stgs_live_settings settings = filmed.settings();
  CHECK(stgs_live_start(live.get(), filmed.recording.c_str(), nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_start(live.get(), nullptr, &settings) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_start(live.get(), "", &settings) == STGS_ERROR_ARGUMENT);
}

TEST_CASE("calls before the start fail, and null objects are accepted or rejected", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = make_live();
  auto report = empty_output<stgs_live_report>();
  CHECK(message_of(live).empty());
  CHECK(filmed.push(live, 0, 0) == STGS_ERROR_STATE);
  CHECK_THAT(message_of(live), Catch::Contains("stgs_live_start"));
  CHECK(stgs_live_end_camera(live.get(), "x") == STGS_ERROR_STATE);
  CHECK(stgs_live_get_report(live.get(), &report) == STGS_ERROR_STATE);
  CHECK(stgs_live_finish(live.get(), nullptr) == STGS_ERROR_STATE);
  CHECK(stgs_live_create(nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_push(nullptr, "x", 0, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_finish(nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_error(nullptr, nullptr) == STGS_ERROR_ARGUMENT);
  const stgs_live_settings settings = filmed.settings();
  stgs_live_cancel(live.get());
  CHECK(stgs_live_start(live.get(), filmed.recording.c_str(), &settings) == STGS_ERROR_CANCELLED);
  stgs_live_cancel(nullptr);
  stgs_live_destroy(nullptr);
}

TEST_CASE("every struct of a live session has defaults in any size", "[sdk]") {
  const stgs_live_settings settings = defaults_of(stgs_live_settings_defaults);
  CHECK(settings.latency == 1.5);
  CHECK(settings.preset == STGS_PRESET_FAST);
  const stgs_live_camera camera = defaults_of(stgs_live_camera_defaults);
  CHECK(camera.rotation[4] == 1);
  CHECK(camera.rotation[5] == 0);
  CHECK(defaults_of(stgs_live_image_defaults).data == nullptr);
  CHECK(sized_structs(STGS_SDK_HEADERS "/stgs_encoder_live.h") ==
        std::set<std::string>{"stgs_live_camera", "stgs_live_window", "stgs_live_settings",
                              "stgs_live_image", "stgs_live_report"});
}

#ifdef STGS_HAS_PREPARE

TEST_CASE("an invalid calibration is rejected with the name of the camera", "[sdk]") {
  FilmedCapture filmed;
  const auto check_rejected = [&](const std::function<void(stgs_live_camera&)>& change,
                                  const char* message) {
    const stgs_live_camera before = filmed.calibration[1];
    change(filmed.calibration[1]);
    CHECK_THAT(rejection_of(filmed, filmed.settings()), Catch::Contains(message));
    filmed.calibration[1] = before;
  };
  check_rejected([](auto& c) { c.name = nullptr; }, "cameras[1]: name is NULL");
  check_rejected([](auto& c) { c.name = ""; }, "camera name");
  check_rejected([](auto& c) { c.name = "a/b"; }, "camera name");
  check_rejected([&](auto& c) { c.name = filmed.calibration[0].name; }, "two cameras are named");
  check_rejected([](auto& c) { c.width = 0; }, "cameras[1]: the size is 0 x 64");
  check_rejected([](auto& c) { c.width = 40000; }, "cameras[1]: the size is 40000 x 64");
  check_rejected([](auto& c) { c.fx = 0; }, "positive focal lengths");
  check_rejected([](auto& c) { c.cx = kNan; }, "not finite");
  check_rejected([](auto& c) { c.rotation[0] = 2; }, "is not a rotation");
  check_rejected([](auto& c) { c.translation[0] = INFINITY; }, "finite");
  check_rejected([](auto& c) { c.distortion[0] = kNan; }, "distortion is not finite");
  check_rejected([](auto& c) { c.lens = 2; }, "lens is 2");
  check_rejected(
      [](auto& c) {
        c.lens = STGS_LENS_FISHEYE;
        c.distortion[5] = 0.1;
      },
      "a fisheye lens has 4 coefficients");
}

TEST_CASE("a rig file states the cameras, without those that are held out", "[sdk]") {
  const FilmedCapture filmed;
  const std::string rig = filmed.path("rig.json");
  stgs_live_settings settings = filmed.settings();
  settings.cameras = nullptr;
  settings.camera_count = 0;
  settings.fps = 0;
  settings.rig = rig.c_str();
  rejection_of(filmed, settings, STGS_ERROR_IO);
  const char* const pose = R"("K": [[90, 0, 48], [0, 90, 32], [0, 0, 1]],
      "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])";
  std::ofstream(rig) << "{\"fps\": 20, \"cameras\": [{\"name\": \"a\", " << pose
                     << "}, {\"name\": \"b\", " << pose << "}, {\"name\": \"c\", \"test\": true, "
                     << pose << "}]}";
  const LivePtr live = filmed.start(settings);
  const LivePixels pixels = filmed.pixels(0, 0);
  CHECK(stgs_live_push(live.get(), "a", 0, &pixels.image) == STGS_OK);
  CHECK(stgs_live_push(live.get(), "b", 0, &pixels.image) == STGS_OK);
  CHECK(stgs_live_push(live.get(), "c", 0, &pixels.image) == STGS_ERROR_ARGUMENT);
  std::ofstream(rig) << "no rig";
  rejection_of(filmed, settings, STGS_ERROR_INVALID_FILE);
}

TEST_CASE("a live session accepts structs of older and newer headers", "[sdk]") {
  const FilmedCapture filmed;
  const stgs_live_settings settings = filmed.settings();
  // Up to `fps` all members are needed.
  check_input_struct("stgs_live_settings", settings, offsetof(stgs_live_settings, scale),
                     [&](const stgs_live_settings* s) {
                       const LivePtr live = make_live();
                       return stgs_live_start(live.get(), filmed.recording.c_str(), s);
                     });
  const LivePtr live = filmed.start(settings);
  const char* const camera = filmed.calibration[0].name;
  const LivePixels pixels(filmed.pixels(0, 0));
  check_input_struct(
      "stgs_live_image", pixels.image, offsetof(stgs_live_image, format),
      [&](const stgs_live_image* image) { return stgs_live_push(live.get(), camera, 0, image); });
  check_output_struct<stgs_live_report>("stgs_live_report", [&](stgs_live_report* report) {
    return stgs_live_get_report(live.get(), report);
  });
}

TEST_CASE("invalid images and times are rejected, and change nothing", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  const char* const camera = filmed.calibration[0].name;
  const LivePixels good = filmed.pixels(0, 0);
  const auto check_rejected = [&](const std::function<void(stgs_live_image&)>& change,
                                  const char* message) {
    stgs_live_image image = good.image;
    change(image);
    CHECK(stgs_live_push(live.get(), camera, 0, &image) == STGS_ERROR_ARGUMENT);
    CHECK_THAT(message_of(live), Catch::Contains(message));
  };
  check_rejected([](auto& i) { i.data = nullptr; }, "data is NULL");
  check_rejected([](auto& i) { i.width = 0; }, "the size is 0 x 64");
  check_rejected([](auto& i) { i.height = 40000; }, "the size is 96 x 40000");
  check_rejected([](auto& i) { i.stride = 3 * i.width - 1; }, "stride is 287");
  check_rejected([](auto& i) { i.format = 4; }, "format is 4");
  check_rejected([](auto& i) { i.memory = -1; }, "memory is -1");
  check_rejected([](auto& i) { i.height = 32; }, "aspect ratio");
  CHECK(stgs_live_push(live.get(), camera, 0, nullptr) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_push(live.get(), camera, kNan, &good.image) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_push(live.get(), camera, INFINITY, &good.image) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_push(live.get(), nullptr, 0, &good.image) == STGS_ERROR_ARGUMENT);
  CHECK(stgs_live_push(live.get(), "nobody", 0, &good.image) == STGS_ERROR_ARGUMENT);
  CHECK_THAT(message_of(live), Catch::Contains("no camera 'nobody'"));
  CHECK(stgs_live_end_camera(live.get(), "nobody") == STGS_ERROR_ARGUMENT);
  CHECK(report_of(live).images == 0);
  REQUIRE(stgs_live_push(live.get(), camera, 0, &good.image) == STGS_OK);
  check_rejected([](auto& i) { i.width /= 2, i.height /= 2; }, "differs in size from the first");
  stgs_live_image device = good.image;
  device.memory = STGS_MEMORY_CUDA;  // memory of the host in fact
  const stgs_result result = stgs_live_push(live.get(), camera, 0, &device);
  CHECK((result == STGS_ERROR_NOT_BUILT || result == STGS_ERROR_UNSUPPORTED ||
         result == STGS_ERROR_ARGUMENT));
  CHECK(report_of(live).images == 1);
}

TEST_CASE("each thread has the error of its own last call", "[sdk]") {
  const FilmedCapture filmed;
  const LivePtr live = filmed.start(filmed.settings());
  CHECK(stgs_live_end_camera(live.get(), "mine") == STGS_ERROR_ARGUMENT);
  std::string before, after;
  std::thread([&] {
    before = message_of(live);
    (void)stgs_live_end_camera(live.get(), "other");
    after = message_of(live);
  }).join();
  CHECK(before.empty());
  CHECK_THAT(after, Catch::Contains("'other'"));
  CHECK_THAT(message_of(live), Catch::Contains("'mine'"));
}

TEST_CASE("a recording is neither overwritten nor shared, and a session starts once", "[sdk]") {
  const FilmedCapture filmed;
  const stgs_live_settings settings = filmed.settings();
  const LivePtr live = filmed.start(settings), other = make_live();
  CHECK(stgs_live_start(live.get(), filmed.path("b.stgs").c_str(), &settings) == STGS_ERROR_STATE);
  CHECK(stgs_live_start(other.get(), filmed.recording.c_str(), &settings) == STGS_ERROR_ARGUMENT);
  const std::string existing = filmed.path("existing.stgs");
  std::ofstream(existing) << "text";
  CHECK(stgs_live_start(other.get(), existing.c_str(), &settings) == STGS_ERROR_IO);
  CHECK(bytes_of(existing).size() == 4);
  CHECK(stgs_live_start(other.get(), filmed.path("no/b.stgs").c_str(), &settings) == STGS_ERROR_IO);
  // A failed start can be repeated.
  CHECK(stgs_live_start(other.get(), filmed.path("b.stgs").c_str(), &settings) == STGS_OK);
}

#else

TEST_CASE("a build without OpenCV or FFmpeg cannot encode live", "[sdk]") {
  const FilmedCapture filmed;
  CHECK_THAT(rejection_of(filmed, filmed.settings(), STGS_ERROR_NOT_BUILT),
             Catch::Contains("OpenCV"));
}

#endif

}  // namespace stgs::testing
