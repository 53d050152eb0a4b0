// SPDX-License-Identifier: Apache-2.0
// Finding late cameras, on a rig that films a ball that falls.
#include "init/timing_check.h"

#include <filesystem>

#include "catch.h"
#include "fixtures/synthetic_rig.h"
#include "fixtures/temporary_folder.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::init;

namespace {

constexpr int kCameras = 5;

// Writes the frames and masks of a rig in which camera `late` is `delay` frames late.
PreparedCapture write(const testing::TemporaryFolder& folder, SyntheticRig rig, int late,
                      int delay) {
  PreparedCapture capture = rig.write(folder.path, kCameras);
  for (Camera& camera : capture.cameras) {
    camera.test = false;
    std::filesystem::create_directories(folder.path + "/masks/" + camera.name);
    for (int f = 0; f < capture.frames; ++f) {
      const int shown = camera.name == fmt::format("c{}", late) ? f - delay : f;
      cv::Mat mask;
      const cv::Mat image = rig.render(camera, shown, &mask);
      REQUIRE(write_png(capture.frame_path(camera, f), image).ok());
      REQUIRE(write_png(capture.mask_path(camera, f), mask).ok());
    }
  }
  return capture;
}

std::vector<LateCamera> check(const PreparedCapture& capture,
                              const CalibrationCheck& calibration = {}) {
  const ProgressSink progress;
  const LogSink log = [](int, const std::string&) {};
  Work work(progress, log);
  std::vector<LateCamera> late;
  const Status status =
      check_timing(capture, training_views(capture, 640), calibration, work, &late);
  INFO(status.message());
  REQUIRE(status.ok());
  return late;
}

SyntheticRig falling(int frames) {
  SyntheticRig rig;
  rig.frames = frames;
  rig.start = {-0.1, -0.5, 2.2};
  rig.velocity = {0.01, 0.09, 0};
  return rig;
}

}  // namespace

TEST_CASE("a camera that is two frames late, or ahead, is found") {
  const int delay = GENERATE(2, -2);
  const testing::TemporaryFolder folder;
  const std::vector<LateCamera> late = check(write(folder, falling(8), 2, delay));
  REQUIRE(late.size() == 1);
  CHECK(late[0].view == 2);
  CHECK(late[0].frames == delay);
}

TEST_CASE(
    "synchronous or miscalibrated cameras, short clips and still scenes have no late camera") {
  const testing::TemporaryFolder folder;
  SyntheticRig rig = falling(8);
  SECTION("synchronous") {
    CHECK(check(write(folder, rig, 2, 0)).empty());
  }
  SECTION("short") {
    CHECK(check(write(folder, falling(5), 2, 2)).empty());
  }
  SECTION("one of two cameras: neither is a minority") {
    PreparedCapture capture = write(folder, rig, 2, 2);
    capture.cameras.resize(2);
    CHECK(check(capture).empty());
  }
  SECTION("a camera whose calibration disagrees") {
    CalibrationCheck calibration;
    calibration.outliers.emplace_back().view = 2;
    CHECK(check(write(folder, rig, 2, 2), calibration).empty());
  }
  SECTION("moving content without features") {
    const PreparedCapture capture = write(folder, rig, 2, 2);
    for (const Camera& camera : capture.cameras) {
      const cv::Mat plain(camera.height, camera.width, CV_8UC3, cv::Scalar(90, 90, 90));
      for (int f = 0; f < capture.frames; ++f)
        REQUIRE(write_png(capture.frame_path(camera, f), plain).ok());
    }
    CHECK(check(capture).empty());
  }
  SECTION("still") {
    rig.velocity = {0, 0, 0};
    CHECK(check(write(folder, rig, 2, 2)).empty());
  }
}
