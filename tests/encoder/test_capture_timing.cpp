// SPDX-License-Identifier: Apache-2.0
// Captures whose cameras are not synchronised and state their times in timing.json.
#include <map>

#include "capture_fixture.h"
#include "src/capture/frame_numbers.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::capture_test;

namespace {

const LogSink kNoLog = [](int, const std::string&) {};

// Writes three cameras: cam00 with 12 images at 30 fps, cam01 that begins 2.3 frames later, and
// cam02 with 6 images at 15 fps.
void write_rig(const TemporaryFolder& folder) {
  write_n3dv(folder.path, 3, 12);
  write_video(folder / "cam02.mp4", 2, 6, 15);
  write_text(folder / "timing.json",
             R"({"cam01": {"time_offset": 0.07666666667}, "cam02": {"fps": 15}})");
}

// Returns the number of the test image that a prepared frame shows.
int shown(const PreparedCapture& prepared, int camera, int frame) {
  Result<Image8> image = load_frame(prepared, prepared.cameras[std::size_t(camera)], frame);
  REQUIRE(image.ok());
  cv::Mat rgb(image->height, image->width, CV_8UC3, image->data.data()), bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  int best = 0;
  for (int k = 1; k < 12; ++k) {
    if (cv::norm(test_image(camera, k), bgr) < cv::norm(test_image(camera, best), bgr)) best = k;
  }
  return best;
}

Status plan_status(const std::string& folder, const PrepareSettings& settings = {}) {
  STGS_ASSIGN(const SourceCapture source, load(folder, settings));
  PreparedCapture prepared;
  return plan_frames(source, settings, prepared, kNoLog).status();
}

}  // namespace

TEST_CASE("unsynchronised cameras are prepared for their common time, with the nearest images") {
  const TemporaryFolder folder;
  write_rig(folder);
  const Result<SourceCapture> source = load(folder.path);
  REQUIRE(source.ok());
  PreparedCapture prepared;
  const auto plans = plan_frames(*source, {}, prepared, kNoLog);
  INFO(plans.status().message());
  REQUIRE(plans.ok());
  CHECK(prepared.time_base == TimeBase{1, 30});
  CHECK(prepared.first_frame == 2);
  CHECK(prepared.frames == 9);
  OpenVideos videos;
  int begin = 0;
  for (const int frames : {4, 5}) {  // the videos continue
    PreparedCapture window = prepared;
    window.folder = folder / fmt::format("out{}", begin);
    window.first_frame += begin;
    window.frames = frames;
    REQUIRE(write_frames(*source, *plans, window, videos, {}).ok());
    REQUIRE(write_prepared_capture(window).ok());
    const Result<PreparedCapture> read = read_prepared_capture(window.folder);
    REQUIRE(read.ok());
    for (int frame = 0; frame < frames; ++frame) {
      const int number = 2 + begin + frame;
      CAPTURE(number);
      CHECK(shown(*read, 0, frame) == number);
      CHECK(shown(*read, 1, frame) == number - 2);
      CHECK(shown(*read, 2, frame) == (number + 1) / 2);
      CHECK(read->time_of(read->cameras[0], frame) == frame);
      CHECK(read->time_of(read->cameras[1], frame) == Approx(frame + 0.3));
      CHECK(read->time_of(read->cameras[2], frame) == Approx(frame + number % 2));
    }
    begin += frames;
  }
}

TEST_CASE("the frames of unsynchronised cameras can be selected from those that all have") {
  const TemporaryFolder folder;
  write_rig(folder);
  PrepareSettings settings;
  settings.first_frame = 3;
  settings.end_frame = 7;
  CHECK(plan_status(folder.path, settings).ok());
  settings.end_frame = 12;
  CHECK(fails_with(plan_status(folder.path, settings), {"frames 3:12", "2:11 in common"}));
  write_text(folder / "timing.json", R"({"cam01": {"time_offset": 20}, "cam02": {"fps": 15}})");
  CHECK(fails_with(plan_status(folder.path), {"'cam01' begins at frame 600", "timing.json"}));
  // Each image would be copied to many frames.
  write_text(folder / "timing.json", R"({"cam02": {"fps": 2}})");
  CHECK(fails_with(plan_status(folder.path), {"'cam02' has 2 fps", "tenth of the 30 fps"}));
  // Without the file they must be synchronised.
  fs::remove(folder / "timing.json");
  CHECK(fails_with(plan_status(folder.path), {"15.000 fps", "timing.json"}));
}

TEST_CASE("cameras that state their times number their images for themselves") {
  SourceCapture source;
  for (const auto& [name, images] : std::map<std::string, std::vector<std::string>>{
           {"cam00", {"cam00/000100.png", "cam00/000101.png"}},
           {"cam01", {"cam01/000037.png", "cam01/000039.png", "cam01/000041.png"}}}) {
    source.cameras.emplace_back();
    source.cameras.back().name = name;
    source.cameras.back().numbered = true;
    source.cameras.back().images = images;
  }
  CHECK(fails_with(check_frame_numbers(source, -1, kNoLog), {"identically for all cameras"}));
  source.has_timing = true;
  CHECK(check_frame_numbers(source, -1, kNoLog).ok());
  source.cameras[1].images[2] = "cam01/000043.png";
  CHECK(fails_with(check_frame_numbers(source, -1, kNoLog), {"cam01", "41"}));
}

TEST_CASE("errors of timing.json name the camera and the key") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 2);
  const auto status = [&](const std::string& text) {
    write_text(folder / "timing.json", text);
    return load(folder.path).status();
  };
  CHECK(status(R"({"cam00": {}})").ok());
  CHECK(fails_with(status("[]"), {"timing.json", "got array"}));
  CHECK(fails_with(status(R"({"cam9": {}})"), {"timing.json", "no camera 'cam9'"}));
  CHECK(fails_with(status(R"({"cam00": 3})"), {"'cam00'", "got number"}));
  CHECK(fails_with(status(R"({"cam00": {"offset": 3}})"), {"'cam00'", "\"offset\""}));
  CHECK(fails_with(status(R"({"cam00": {"fps": 0}})"), {"'cam00'", "fps is 0"}));
  CHECK(fails_with(status(R"({"cam00": {"time_offset": "a"}})"), {"time_offset is \"a\""}));
}
