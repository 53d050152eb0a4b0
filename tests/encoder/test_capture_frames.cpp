// SPDX-License-Identifier: Apache-2.0
// Frames of a capture: undistortion, scaling, synchronisation, writing and rejected inputs.
#include <opencv2/calib3d.hpp>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/run_program.h"

namespace stgs::encoder::capture_test {
namespace {

// A 320x240 camera with strong distortion.
SourceCamera lens_camera(bool fisheye) {
  SourceCamera camera;
  camera.name = "lens";
  camera.fx = 210;
  camera.fy = 205;
  camera.cx = 163.5;
  camera.cy = 118.5;
  camera.lens = fisheye ? LensModel::kFisheye : LensModel::kOpenCv;
  camera.distortion = fisheye ? std::vector<double>{0.05, -0.01, 0.002, 0}
                              : std::vector<double>{-0.25, 0.08, 0.001, -0.002};
  return camera;
}

// A Gaussian dot at `p`; pixel centres are at integers.
cv::Mat dot(const cv::Point2d& p, int width, int height) {
  cv::Mat image(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double d = (x - p.x) * (x - p.x) + (y - p.y) * (y - p.y);
      image.at<cv::Vec3b>(y, x) = cv::Vec3b::all(cv::saturate_cast<uchar>(250 * std::exp(-d / 12)));
    }
  }
  return image;
}

// Centroid of the dot; pixel centres are at +0.5.
cv::Point2d centroid_of(const cv::Mat& image) {
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  const cv::Moments m = cv::moments(grey);
  return {m.m10 / m.m00 + 0.5, m.m01 / m.m00 + 0.5};
}

TEST_CASE("undistorted points lie where the pinhole camera projects them") {
  const bool fisheye = GENERATE(false, true);
  const double scale = GENERATE(1.0, 0.5);
  const SourceCamera source = lens_camera(fisheye);
  const FrameInfo info{320, 240, 1, 0};
  const auto plan = plan_camera(source, info, scale);
  REQUIRE(plan.ok());
  const FrameMapping mapping(*plan);
  const Camera& camera = plan->camera;
  CHECK(camera.width == 320 * scale);
  const cv::Matx33d k(source.fx, 0, source.cx - 0.5, 0, source.fy, source.cy - 0.5, 0, 0, 1);
  for (const double x : {-0.5, -0.2, 0.0, 0.3, 0.55}) {
    for (const double y : {-0.35, 0.0, 0.4}) {
      std::vector<cv::Point2d> distorted;
      if (fisheye) {
        cv::fisheye::distortPoints(std::vector<cv::Point2d>{{x, y}}, distorted, k,
                                   source.distortion);
      } else {
        cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}}, cv::Vec3d(), cv::Vec3d(), k,
                          source.distortion, distorted);
      }
      const cv::Mat image = dot(distorted[0], 320, 240), before = image.clone();
      const cv::Point2d found = centroid_of(*mapping.frame(image));
      CHECK(cv::norm(image, before, cv::NORM_INF) == 0);  // the source is unchanged
      CHECK(std::abs(found.x - (camera.fx * x + camera.cx)) < 0.3);
      CHECK(std::abs(found.y - (camera.fy * y + camera.cy)) < 0.3);
    }
  }
}

TEST_CASE("undistortion zooms just enough to avoid a border") {
  SourceCamera source = lens_camera(false);
  source.distortion = {0.15, 0.02, 0, 0};  // pincushion: the corners map outside the source image
  const auto plan = plan_camera(source, {320, 240, 1, 0}, 1);
  REQUIRE(plan.ok());
  CHECK(plan->zoom > 1.02);
  CHECK(plan->zoom < kMaxUndistortionZoom);
  CHECK_FALSE(plan->has_border);
  CHECK(plan->camera.fx == Approx(source.fx * plan->zoom));
  CHECK(plan->camera.cx == source.cx);
  double low = 0, high = 0;
  cv::minMaxLoc(FrameMapping(*plan).map_x(), &low, &high);
  CHECK(low >= -0.51);
  CHECK(high <= 319.51);
}

TEST_CASE("intrinsics scale with the frame size, and another aspect ratio is rejected") {
  SourceCamera source = lens_camera(false);
  source.lens = LensModel::kPinhole;
  source.width = 640, source.height = 480;
  source.video = "a.mp4";
  const auto plan = plan_camera(source, {320, 240, 1, 0}, 1);
  REQUIRE(plan.ok());
  CHECK(plan->camera.fx == 105);
  CHECK(plan->camera.cx == Approx(81.75));
  CHECK(fails_with(plan_camera(source, {320, 320, 1, 0}, 1).status(),
                   {"a.mp4", "'lens'", "320x320", "640x480"}));
}

Result<std::vector<CameraPlan>> plan(const std::string& folder, const PrepareSettings& settings,
                                     PreparedCapture& prepared) {
  STGS_ASSIGN(const SourceCapture source, load(folder, settings));
  return plan_frames(source, settings, prepared, [](int, const std::string&) {});
}

Status write(const std::string& folder, const PrepareSettings& settings, const std::string& out,
             PreparedCapture& prepared) {
  prepared.folder = out;
  STGS_ASSIGN(const SourceCapture source, load(folder, settings));
  STGS_ASSIGN(const auto plans,
              plan_frames(source, settings, prepared, [](int, const std::string&) {}));
  OpenVideos videos;
  return write_frames(source, plans, prepared, videos, {});
}

TEST_CASE("the selected frames of videos are written, scaled") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 6);
  PrepareSettings settings;
  settings.first_frame = 2;
  settings.end_frame = 5;
  settings.scale = 0.5;
  settings.test_cameras = {"cam01"};
  PreparedCapture prepared;
  REQUIRE(write(folder.path, settings, folder / "out", prepared).ok());
  CHECK(prepared.frames == 3);
  CHECK(prepared.first_frame == 2);
  CHECK(prepared.time_base == TimeBase{1, 30});
  CHECK(prepared.frame_extension == "png");
  const Camera& camera = prepared.cameras[1];
  CHECK(camera.test);
  CHECK_FALSE(prepared.cameras[0].test);
  CHECK(camera.width == kWidth / 2);
  CHECK(camera.cx == kWidth / 4.0);
  for (int frame = 0; frame < 3; ++frame) {
    auto image = load_frame(prepared, camera, frame);
    REQUIRE(image.ok());
    cv::Mat expected, rgb(image->height, image->width, CV_8UC3, image->data.data());
    cv::resize(test_image(1, frame + 2), expected, {kWidth / 2, kHeight / 2}, 0, 0, cv::INTER_AREA);
    cv::cvtColor(expected, expected, cv::COLOR_BGR2RGB);
    // The video is lossy.
    CHECK(cv::norm(expected, rgb, cv::NORM_L1) / double(expected.total() * 3) < 8);
    cv::Mat earlier;
    cv::resize(test_image(1, frame), earlier, {kWidth / 2, kHeight / 2}, 0, 0, cv::INTER_AREA);
    cv::cvtColor(earlier, earlier, cv::COLOR_BGR2RGB);
    CHECK(cv::norm(expected, rgb, cv::NORM_L1) < 0.5 * cv::norm(earlier, rgb, cv::NORM_L1));
  }
  CHECK_FALSE(fs::exists(prepared.frame_path(camera, 3)));
}

TEST_CASE("cameras of different length or frame rate are rejected by name") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 4);
  write_video(folder / "cam02.mp4", 2, 3);
  PreparedCapture prepared;
  CHECK(fails_with(plan(folder.path, {}, prepared).status(),
                   {"'cam02' has 3 frames", "has 4", "synchronised", "--frames 0:3"}));
  PrepareSettings settings;
  settings.end_frame = 3;
  PreparedCapture shorter;
  CHECK(plan(folder.path, settings, shorter).ok());
  settings.end_frame = 4;
  PreparedCapture longer;
  CHECK(fails_with(plan(folder.path, settings, longer).status(), {"0:4", "'cam02' has 3 frames"}));
  write_video(folder / "cam02.mp4", 2, 4, 25);
  PreparedCapture rates;
  CHECK(fails_with(plan(folder.path, {}, rates).status(), {"'cam02'", "25.000", "30.000"}));
}

TEST_CASE("errors name missing and damaged n3dv files") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 2);
  fs::remove(folder / "cam01.mp4");
  CHECK(fails_with(load(folder.path).status(), {"poses_bounds.npy", "3 cameras", "2 videos"}));
  write_text(folder / "cam01.mp4", "no video");
  PreparedCapture prepared;
  CHECK(fails_with(plan(folder.path, {}, prepared).status(), {"cam01.mp4", "'cam01'"}));
  shorten(folder / "poses_bounds.npy", 1);
  CHECK(fails_with(load(folder.path).status(), {"poses_bounds.npy", "truncated"}));
  shorten(folder / "poses_bounds.npy", fs::file_size(folder / "poses_bounds.npy") - 20);
  CHECK(fails_with(load(folder.path).status(), {"poses_bounds.npy", "header"}));
}

// One folder of images per camera, and cameras.json.
void write_image_capture(const TemporaryFolder& folder, int frames,
                         const std::string& extension = "png") {
  std::string list;
  for (int i = 0; i < 3; ++i) {
    const Camera c = known_camera(i, 3, "");
    list += fmt::format("{}\"c{}\":{{\"K\":{},\"w2c\":{}}}", i == 0 ? "" : ",", i,
                        json_list(matrix_k(c)), json_list(world_to_camera(c)));
    write_images(folder / fmt::format("images/c{}", i), i, frames, extension);
  }
  write_text(folder / "cameras.json", "{" + list + "}");
}

TEST_CASE("errors name the camera and frame of missing, damaged and differently sized images") {
  const TemporaryFolder folder;
  write_image_capture(folder, 3);
  PreparedCapture first;
  REQUIRE(write(folder.path, {}, folder / "out1", first).ok());
  CHECK(first.frame_extension == "png");

  write_image(folder / "images/c1/000002.png", test_image(1, 2, 32, 24));
  PreparedCapture mixed;
  CHECK(fails_with(write(folder.path, {}, folder / "out2", mixed),
                   {"c1/000002.png", "camera 'c1' frame 2", "32x24", "64x48"}));
  PrepareSettings half;
  half.scale = 0.5;
  PreparedCapture scaled;
  CHECK(fails_with(write(folder.path, half, folder / "out3", scaled),
                   {"c1/000002.png", "camera 'c1' frame 2", "32x24", "64x48"}));

  write_text(folder / "images/c1/000002.png", "not an image");
  PreparedCapture damaged;
  CHECK(fails_with(write(folder.path, {}, folder / "out4", damaged),
                   {"c1/000002.png", "'c1' frame 2"}));

  fs::remove(folder / "images/c1/000002.png");
  PreparedCapture missing;
  CHECK(fails_with(write(folder.path, {}, folder / "out5", missing), {"'c1' has 2 frames"}));
}

TEST_CASE("a truncated JPEG is rejected by name, and one with trailing bytes is read") {
  const TemporaryFolder folder;
  write_image_capture(folder, 3, "jpg");
  const std::string path = folder / "images/c1/000002.jpg";
  PrepareSettings settings;
  settings.scale = GENERATE(1.0, 0.5);  // copied at 1, decoded and scaled at 0.5
  std::string bytes;
  {
    std::ifstream file(path, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(file), {});
  }
  // A thumbnail in an APP1 segment, and trailing bytes, as cameras write them.
  const std::string thumbnail = std::string("\xff\xe1\0\x08\xff\xd8\xff\xd9", 8) + "ab";
  const std::string complete = bytes.substr(0, 2) + thumbnail + bytes.substr(2);
  write_bytes(path, complete + std::string(64, '\0') + "more");
  PreparedCapture read;
  REQUIRE(write(folder.path, settings, folder / "out1", read).ok());
  CHECK(load_frame(read, read.cameras[1], 2).ok());

  for (const std::size_t size : {complete.size() - 2, complete.size() / 2}) {
    write_bytes(path, complete.substr(0, size));
    PreparedCapture cut;
    const Status status = write(folder.path, settings, folder / "out2", cut);
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(fails_with(status, {"c1/000002.jpg", "camera 'c1' frame 2", "no end-of-image marker"}));
  }
  // A capture damaged after it was prepared.
  if (settings.scale != 1.0) return;
  shorten(read.frame_path(read.cameras[1], 2), complete.size() / 2);
  CHECK(fails_with(load_frame(read, read.cameras[1], 2).status(),
                   {"c1/000002.jpg", "no end-of-image marker"}));
}

TEST_CASE("errors in cameras.json name the camera and the entry") {
  const TemporaryFolder folder;
  write_image_capture(folder, 1);
  shorten(folder / "cameras.json", 10);
  CHECK(fails_with(load(folder.path).status(), {"cameras.json"}));
  write_text(folder / "cameras.json", "{\"c0\":{\"K\":[1,0,0,0,1,0,0,0,1]}}");
  CHECK(fails_with(load(folder.path).status(), {"cameras.json", "'c0'", "w2c"}));
  write_text(folder / "cameras.json",
             "{\"c9\":{\"K\":[9,0,5,0,9,5,0,0,1],\"w2c\":[1,0,0,0,0,1,0,0,0,0,1,0]}}");
  CHECK(fails_with(load(folder.path).status(), {"'c9'", "no frames"}));
  write_text(folder / "cameras.json",
             "{\"c0\":{\"K\":[9,0,5,0,9,5,0,0,1],\"w2c\":[2,0,0,0,0,1,0,0,0,0,1,0]}}");
  CHECK(fails_with(load(folder.path).status(), {"'c0'", "rotation"}));
}

std::vector<std::string> entries_of(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

TEST_CASE("prepare writes the complete folder or nothing") {
  const TemporaryFolder folder;
  write_n3dv(folder / "in", 4, 3);
  const std::string out = folder / "out";
  PrepareSettings settings;
  const auto log = [](int, const std::string&) {};

  SECTION("a cancelled run leaves nothing") {
    const auto cancel = [](const Progress&) { return false; };
    CHECK(fails_with(prepare(folder / "in", out, settings, cancel, log), {"cancelled"}));
    CHECK(entries_of(folder.path) == std::vector<std::string>{"in"});
  }
  SECTION("a damaged capture leaves nothing") {
    write_text(folder / "in/cam02.mp4", "no video");
    CHECK(fails_with(prepare(folder / "in", out, settings, {}, log), {"cam02"}));
    CHECK(entries_of(folder.path) == std::vector<std::string>{"in"});
  }
  SECTION("an existing folder is replaced only with overwrite") {
    const Status status = prepare(folder / "in", out + "/", settings, {}, log);
    INFO(status.message());
    REQUIRE(status.ok());
    const auto prepared = read_prepared_capture(out);
    REQUIRE(prepared.ok());
    CHECK(prepared->source == "n3dv");
    CHECK(prepared->frames == 3);
    CHECK(load_frame(*prepared, prepared->cameras[3], 2).ok());
    CHECK(fails_with(prepare(folder / "in", out, settings, {}, log), {out, "exists"}));
    settings.overwrite = true;
    settings.end_frame = 2;
    REQUIRE(prepare(folder / "in", out, settings, {}, log).ok());
    CHECK(read_prepared_capture(out)->frames == 2);
    CHECK(entries_of(folder.path) == std::vector<std::string>{"in", "out"});
  }
  SECTION("overwrite never replaces another kind of folder") {
    settings.overwrite = true;
    CHECK(fails_with(prepare(folder / "in", folder / "in", settings, {}, log), {"is the capture"}));
    CHECK(fails_with(prepare(folder / "in", folder.path, settings, {}, log), {"contains it"}));
    write_text(folder / "mine/letter.txt", "keep me");
    CHECK(
        fails_with(prepare(folder / "in", folder / "mine", settings, {}, log), {"not a prepared"}));
    CHECK(fs::exists(folder / "mine/letter.txt"));
  }
  SECTION("invalid settings are rejected") {
    settings.scale = 1.5;
    CHECK(fails_with(prepare(folder / "in", out, settings, {}, log), {"1.5"}));
    settings.scale = 1;
    settings.test_cameras = {"cam09"};
    CHECK(fails_with(prepare(folder / "in", out, settings, {}, log), {"cam09", "cam03"}));
  }
}

// A .flo file of constant flow; a `width` other than kWidth makes it invalid.
void write_flow(const std::string& path, float u, float v, std::int32_t width = kWidth) {
  std::string bytes;
  append(bytes, 202021.25f);
  append(bytes, width);
  append(bytes, std::int32_t{kHeight});
  for (int i = 0; i < kWidth * kHeight; ++i) {
    append(bytes, u);
    append(bytes, v);
  }
  write_bytes(path, bytes);
}

TEST_CASE("prepare uses the flow and masks supplied with a capture") {
  const TemporaryFolder folder;
  const std::string in = folder / "in";
  write_n3dv(in, 4, 3);
  const auto log = [](int, const std::string& line) { log_lines().push_back(line); };
  log_lines().clear();

  SECTION("flow is looked up by camera and source frame") {
    PrepareSettings settings;
    settings.first_frame = 1;
    write_flow(in + "/flow/cam02/000001.flo", 3, 0, 30000);
    CHECK(fails_with(prepare(in, folder / "out", settings, {}, log), {"cam02/000001.flo"}));
    write_flow(in + "/flow/cam02/000001.flo", 3, 0);
    write_flow(in + "/flow/cam00/000001.flo", 3, 0, 30000);  // of the held-out camera
    write_flow(in + "/flow/cam02/000000.flo", 3, 0, 30000);  // before the first frame
    const Status status = prepare(in, folder / "out", settings, {}, log);
    INFO(status.message());
    CHECK(status.ok());
  }
  SECTION("masks are copied unchanged") {
    cv::Mat mask = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
    mask.colRange(0, kWidth / 2).setTo(255);
    for (int f = 0; f < 3; ++f) write_image(fmt::format("{}/masks/cam02/{:06}.png", in, f), mask);
    const Status status = prepare(in, folder / "out", {}, {}, log);
    INFO(status.message());
    REQUIRE(status.ok());
    const auto prepared = read_prepared_capture(folder / "out");
    REQUIRE(prepared.ok());
    const auto copied = load_mask(*prepared, prepared->cameras[2], 1);
    REQUIRE(copied.ok());
    CHECK(int(copied->data[0]) == 255);
    CHECK(int(copied->data[kWidth - 1]) == 0);
  }
}

TEST_CASE("the reason of a failed program is its last error line") {
  const TemporaryFolder folder;
  const std::string log = folder / "log.txt";
  write_text(log,
             "working\nE20240102 03:04:05.678901  12 a.cc:1] first\n"
             "F20240102 03:04:05.678901  12 sfm.cc:473] Check failed: solved \n"
             "*** Check failure stack trace: ***\n    @     0x7fc7  main\n");
  CHECK(failure_reason(log) == ": Check failed: solved");
  write_text(log, "ERROR: Failed to parse options\n");
  CHECK(failure_reason(log) == ": Failed to parse options");
  write_text(log, "one\ntwo\n");
  CHECK(failure_reason(log) == "; its last lines were: one | two");
}

}  // namespace
}  // namespace stgs::encoder::capture_test
