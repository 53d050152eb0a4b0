// SPDX-License-Identifier: Apache-2.0
// Frames: undistortion, scale, synchronisation, what is written, and what is refused.
#include <opencv2/calib3d.hpp>

#include "capture_fixture.h"
#include "catch.h"
#include "src/capture/run_program.h"

namespace stgs::encoder::capture_test {
namespace {

// A camera of 320x240 with a strong lens.
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

// A soft dot at `p` (integer pixel centres).
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

// Its place, with pixel centres at +0.5.
cv::Point2d place_of(const cv::Mat& image) {
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  const cv::Moments m = cv::moments(grey);
  return {m.m10 / m.m00 + 0.5, m.m01 / m.m00 + 0.5};
}

TEST_CASE("what a lens bends comes out where the pinhole camera sees it") {
  const bool fisheye = GENERATE(false, true);
  const double scale = GENERATE(1.0, 0.5);
  const SourceCamera source = lens_camera(fisheye);
  const FrameInfo info{320, 240, 1, 0};
  const auto plan = plan_camera(source, info, scale);
  REQUIRE(plan.ok());
  const Camera& camera = plan->camera;
  CHECK(camera.width == 320 * scale);
  const cv::Matx33d k(source.fx, 0, source.cx - 0.5, 0, source.fy, source.cy - 0.5, 0, 0, 1);
  for (const double x : {-0.5, -0.2, 0.0, 0.3, 0.55}) {
    for (const double y : {-0.35, 0.0, 0.4}) {
      std::vector<cv::Point2d> bent;
      if (fisheye) {
        cv::fisheye::distortPoints(std::vector<cv::Point2d>{{x, y}}, bent, k, source.distortion);
      } else {
        cv::projectPoints(std::vector<cv::Point3d>{{x, y, 1}}, cv::Vec3d(), cv::Vec3d(), k,
                          source.distortion, bent);
      }
      const cv::Point2d found = place_of(plan->frame(dot(bent[0], 320, 240)));
      CHECK(std::abs(found.x - (camera.fx * x + camera.cx)) < 0.3);
      CHECK(std::abs(found.y - (camera.fy * y + camera.cy)) < 0.3);
    }
  }
}

TEST_CASE("undistortion zooms just enough to leave no border") {
  SourceCamera source = lens_camera(false);
  source.distortion = {0.15, 0.02, 0, 0};  // pincushion: the corners come from outside
  const auto plan = plan_camera(source, {320, 240, 1, 0}, 1);
  REQUIRE(plan.ok());
  CHECK(plan->zoom > 1.02);
  CHECK(plan->zoom < kMaxUndistortionZoom);
  CHECK_FALSE(plan->has_border);
  CHECK(plan->camera.fx == Approx(source.fx * plan->zoom));
  CHECK(plan->camera.cx == source.cx);
  double low = 0, high = 0;
  cv::minMaxLoc(plan->map_x, &low, &high);
  CHECK(low >= -0.51);
  CHECK(high <= 319.51);
}

TEST_CASE("intrinsics follow the frames' size, but not another shape") {
  SourceCamera source = lens_camera(false);
  source.lens = LensModel::kPinhole;
  source.width = 640, source.height = 480;
  source.video = "a.mp4";
  const auto plan = plan_camera(source, {320, 240, 1, 0}, 1);
  REQUIRE(plan.ok());
  CHECK(plan->camera.fx == 105);
  CHECK(plan->camera.cx == Approx(81.75));
  CHECK(says(plan_camera(source, {320, 320, 1, 0}, 1).status(),
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
  return write_frames(source, plans, prepared, {});
}

TEST_CASE("videos become the frames asked for, scaled") {
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
    cv::Mat truth, rgb(image->height, image->width, CV_8UC3, image->data.data());
    cv::resize(picture(1, frame + 2), truth, {kWidth / 2, kHeight / 2}, 0, 0, cv::INTER_AREA);
    cv::cvtColor(truth, truth, cv::COLOR_BGR2RGB);
    CHECK(cv::norm(truth, rgb, cv::NORM_L1) / double(truth.total() * 3) < 8);  // a lossy video
    cv::Mat earlier;
    cv::resize(picture(1, frame), earlier, {kWidth / 2, kHeight / 2}, 0, 0, cv::INTER_AREA);
    cv::cvtColor(earlier, earlier, cv::COLOR_BGR2RGB);
    CHECK(cv::norm(truth, rgb, cv::NORM_L1) < 0.5 * cv::norm(earlier, rgb, cv::NORM_L1));
  }
  CHECK_FALSE(fs::exists(prepared.frame_path(camera, 3)));
}

TEST_CASE("cameras of different lengths and rates are refused by name") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 4);
  write_video(folder / "cam02.mp4", 2, 3);
  PreparedCapture prepared;
  CHECK(says(plan(folder.path, {}, prepared).status(),
             {"'cam02' has 3 frames", "has 4", "synchronised", "--frames 0:3"}));
  PrepareSettings settings;
  settings.end_frame = 3;
  PreparedCapture shorter;
  CHECK(plan(folder.path, settings, shorter).ok());
  settings.end_frame = 4;
  PreparedCapture longer;
  CHECK(says(plan(folder.path, settings, longer).status(), {"0:4", "'cam02' has 3 frames"}));
  write_video(folder / "cam02.mp4", 2, 4, 25);
  PreparedCapture rates;
  CHECK(says(plan(folder.path, {}, rates).status(), {"'cam02'", "25.000", "30.000"}));
}

TEST_CASE("missing and damaged n3dv files are named") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 2);
  fs::remove(folder / "cam01.mp4");
  CHECK(says(load(folder.path).status(), {"poses_bounds.npy", "3 cameras", "2 videos"}));
  write_text(folder / "cam01.mp4", "no video");
  PreparedCapture prepared;
  CHECK(says(plan(folder.path, {}, prepared).status(), {"cam01.mp4", "'cam01'"}));
  shorten(folder / "poses_bounds.npy", 1);
  CHECK(says(load(folder.path).status(), {"poses_bounds.npy", "truncated"}));
  shorten(folder / "poses_bounds.npy", fs::file_size(folder / "poses_bounds.npy") - 20);
  CHECK(says(load(folder.path).status(), {"poses_bounds.npy", "header"}));
}

// Folders of pictures with a cameras.json.
void write_picture_capture(const TemporaryFolder& folder, int frames,
                           const std::string& extension = "png") {
  std::string list;
  for (int i = 0; i < 3; ++i) {
    const Camera c = known_camera(i, 3, "");
    list += fmt::format("{}\"c{}\":{{\"K\":{},\"w2c\":{}}}", i == 0 ? "" : ",", i,
                        json_list(matrix_k(c)), json_list(world_to_camera(c)));
    write_pictures(folder / fmt::format("images/c{}", i), i, frames, extension);
  }
  write_text(folder / "cameras.json", "{" + list + "}");
}

TEST_CASE("pictures of mixed sizes, missing and damaged ones are named with camera and frame") {
  const TemporaryFolder folder;
  write_picture_capture(folder, 3);
  PreparedCapture first;
  REQUIRE(write(folder.path, {}, folder / "out1", first).ok());
  CHECK(first.frame_extension == "png");

  write_picture(folder / "images/c1/000002.png", picture(1, 2, 32, 24));
  PreparedCapture mixed;
  CHECK(says(write(folder.path, {}, folder / "out2", mixed),
             {"c1/000002.png", "camera 'c1' frame 2", "32x24", "64x48"}));
  PrepareSettings half;
  half.scale = 0.5;
  PreparedCapture scaled;
  CHECK(says(write(folder.path, half, folder / "out3", scaled),
             {"c1/000002.png", "camera 'c1' frame 2", "32x24", "64x48"}));

  write_text(folder / "images/c1/000002.png", "not a picture");
  PreparedCapture damaged;
  CHECK(says(write(folder.path, {}, folder / "out4", damaged), {"c1/000002.png", "'c1' frame 2"}));

  fs::remove(folder / "images/c1/000002.png");
  PreparedCapture missing;
  CHECK(says(write(folder.path, {}, folder / "out5", missing), {"'c1' has 2 frames"}));
}

TEST_CASE("a JPEG that was cut short is named, and one with bytes behind its end is read") {
  const TemporaryFolder folder;
  write_picture_capture(folder, 3, "jpg");
  const std::string path = folder / "images/c1/000002.jpg";
  PrepareSettings settings;
  settings.scale = GENERATE(1.0, 0.5);  // copied, and decoded by OpenCV
  std::string bytes;
  {
    std::ifstream file(path, std::ios::binary);
    bytes.assign(std::istreambuf_iterator<char>(file), {});
  }
  // A thumbnail in a segment, and what cameras leave behind the picture.
  const std::string thumbnail = std::string("\xff\xe1\0\x08\xff\xd8\xff\xd9", 8) + "ab";
  const std::string whole = bytes.substr(0, 2) + thumbnail + bytes.substr(2);
  write_bytes(path, whole + std::string(64, '\0') + "more");
  PreparedCapture read;
  REQUIRE(write(folder.path, settings, folder / "out1", read).ok());
  CHECK(load_frame(read, read.cameras[1], 2).ok());

  for (const std::size_t kept : {whole.size() - 2, whole.size() / 2}) {
    write_bytes(path, whole.substr(0, kept));
    PreparedCapture cut;
    const Status status = write(folder.path, settings, folder / "out2", cut);
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(says(status, {"c1/000002.jpg", "camera 'c1' frame 2", "no end-of-image marker"}));
  }
  // Of a capture that was damaged once it was prepared.
  if (settings.scale != 1.0) return;
  shorten(read.frame_path(read.cameras[1], 2), whole.size() / 2);
  CHECK(says(load_frame(read, read.cameras[1], 2).status(),
             {"c1/000002.jpg", "no end-of-image marker"}));
}

TEST_CASE("damaged cameras.json") {
  const TemporaryFolder folder;
  write_picture_capture(folder, 1);
  shorten(folder / "cameras.json", 10);
  CHECK(says(load(folder.path).status(), {"cameras.json"}));
  write_text(folder / "cameras.json", "{\"c0\":{\"K\":[1,0,0,0,1,0,0,0,1]}}");
  CHECK(says(load(folder.path).status(), {"cameras.json", "'c0'", "w2c"}));
  write_text(folder / "cameras.json",
             "{\"c9\":{\"K\":[9,0,5,0,9,5,0,0,1],\"w2c\":[1,0,0,0,0,1,0,0,0,0,1,0]}}");
  CHECK(says(load(folder.path).status(), {"'c9'", "no frames"}));
  write_text(folder / "cameras.json",
             "{\"c0\":{\"K\":[9,0,5,0,9,5,0,0,1],\"w2c\":[2,0,0,0,0,1,0,0,0,0,1,0]}}");
  CHECK(says(load(folder.path).status(), {"'c0'", "rotation"}));
}

std::vector<std::string> entries_of(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

TEST_CASE("prepare leaves the whole folder or nothing") {
  const TemporaryFolder folder;
  write_n3dv(folder / "in", 4, 3);
  const std::string out = folder / "out";
  PrepareSettings settings;
  const auto log = [](int, const std::string&) {};

  SECTION("cancelled") {
    const auto cancel = [](const Progress&) { return false; };
    CHECK(says(prepare(folder / "in", out, settings, cancel, log), {"cancelled"}));
    CHECK(entries_of(folder.path) == std::vector<std::string>{"in"});
  }
  SECTION("damaged capture") {
    write_text(folder / "in/cam02.mp4", "no video");
    CHECK(says(prepare(folder / "in", out, settings, {}, log), {"cam02"}));
    CHECK(entries_of(folder.path) == std::vector<std::string>{"in"});
  }
  SECTION("whole, then kept, then replaced") {
    const Status status = prepare(folder / "in", out + "/", settings, {}, log);
    INFO(status.message());
    REQUIRE(status.ok());
    const auto prepared = read_prepared_capture(out);
    REQUIRE(prepared.ok());
    CHECK(prepared->source == "n3dv");
    CHECK(prepared->frames == 3);
    CHECK(load_frame(*prepared, prepared->cameras[3], 2).ok());
    CHECK(says(prepare(folder / "in", out, settings, {}, log), {out, "exists"}));
    settings.overwrite = true;
    settings.end_frame = 2;
    REQUIRE(prepare(folder / "in", out, settings, {}, log).ok());
    CHECK(read_prepared_capture(out)->frames == 2);
    CHECK(entries_of(folder.path) == std::vector<std::string>{"in", "out"});
  }
  SECTION("never over something else") {
    settings.overwrite = true;
    CHECK(says(prepare(folder / "in", folder / "in", settings, {}, log), {"is the capture"}));
    CHECK(says(prepare(folder / "in", folder.path, settings, {}, log), {"contains it"}));
    write_text(folder / "mine/letter.txt", "keep me");
    CHECK(says(prepare(folder / "in", folder / "mine", settings, {}, log), {"not a prepared"}));
    CHECK(fs::exists(folder / "mine/letter.txt"));
  }
  SECTION("settings that make no sense") {
    settings.scale = 1.5;
    CHECK(says(prepare(folder / "in", out, settings, {}, log), {"1.5"}));
    settings.scale = 1;
    settings.test_cameras = {"cam09"};
    CHECK(says(prepare(folder / "in", out, settings, {}, log), {"cam09", "cam03"}));
  }
}

// A .flo file of one flow everywhere; `width` may lie, to make it a bad one.
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

TEST_CASE("prepare uses the flow and the masks beside a capture") {
  const TemporaryFolder folder;
  const std::string in = folder / "in";
  write_n3dv(in, 4, 3);
  const auto log = [](int, const std::string& line) { log_lines().push_back(line); };
  log_lines().clear();

  SECTION("flow is read, by camera and source frame") {
    PrepareSettings settings;
    settings.first_frame = 1;
    write_flow(in + "/flow/cam02/000001.flo", 3, 0, 30000);
    CHECK(says(prepare(in, folder / "out", settings, {}, log), {"cam02/000001.flo"}));
    write_flow(in + "/flow/cam02/000001.flo", 3, 0);
    write_flow(in + "/flow/cam00/000001.flo", 3, 0, 30000);  // of the held-out camera
    write_flow(in + "/flow/cam02/000000.flo", 3, 0, 30000);  // before the first frame
    const Status status = prepare(in, folder / "out", settings, {}, log);
    INFO(status.message());
    CHECK(status.ok());
  }
  SECTION("masks are kept as they are") {
    cv::Mat mask = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
    mask.colRange(0, kWidth / 2).setTo(255);
    for (int f = 0; f < 3; ++f) write_picture(fmt::format("{}/masks/cam02/{:06}.png", in, f), mask);
    const Status status = prepare(in, folder / "out", {}, {}, log);
    INFO(status.message());
    REQUIRE(status.ok());
    const auto prepared = read_prepared_capture(folder / "out");
    REQUIRE(prepared.ok());
    const auto kept = load_mask(*prepared, prepared->cameras[2], 1);
    REQUIRE(kept.ok());
    CHECK(int(kept->data[0]) == 255);
    CHECK(int(kept->data[kWidth - 1]) == 0);
  }
}

TEST_CASE("why a program failed is its own last error line") {
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
  CHECK(failure_reason(log) == "; its last lines were:\n  one\n  two");
}

}  // namespace
}  // namespace stgs::encoder::capture_test
