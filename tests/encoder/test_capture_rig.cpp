// SPDX-License-Identifier: Apache-2.0
// The calibration that a prepared capture states for other recordings of its rig.
#include "capture_fixture.h"
#include "src/capture/rig_file.h"

namespace stgs::encoder::capture_test {
namespace {

constexpr int kCameras = 3;

void write_videos(const TemporaryFolder& folder) {
  for (int i = 0; i < kCameras; ++i)
    write_video(folder / fmt::format("videos/cam{:02}.mp4", i + 1), i, 1);
}

// Intrinsics are stated for twice the size of the frames, in OpenCV's convention.
void write_calibration(const std::string& path, const std::string& lens) {
  std::string list;
  for (int i = 0; i < kCameras; ++i) {
    Camera c = known_camera(i, kCameras, "");
    for (double* v : {&c.fx, &c.fy, &c.cx, &c.cy}) *v *= 2;
    list += fmt::format("{}\"cam{:02}\":{{\"K\":{},\"w2c\":{},\"width\":{},\"height\":{}{}}}",
                        i == 0 ? "" : ",", i + 1, json_list(matrix_k(c, 0)),
                        json_list(world_to_camera(c)), 2 * kWidth, 2 * kHeight, lens);
  }
  write_text(path, R"({"metric": true, "pixel_centre": 0, "cameras": {)" + list + "}}");
}

TEST_CASE("the rig file of a prepared capture calibrates other recordings of the rig") {
  const TemporaryFolder folder, other;
  write_videos(folder);
  const auto* lens = GENERATE("", R"(,"dist":[-0.1,0.01,0,0])",
                              R"(,"dist":[0.1,0,0,0],"fisheye":true,"test":false)");
  write_calibration(folder / "cameras.json", lens);
  const auto capture = load(folder.path);
  REQUIRE(capture.ok());
  PreparedCapture prepared;
  const auto plans = plan_frames(*capture, {}, prepared, {});
  REQUIRE(plans.ok());
  write_videos(other);
  REQUIRE(write_rig(*capture, *plans, 25, other / "cameras.json").ok());
  const auto found = load(other.path);
  INFO(found.status().message());
  REQUIRE(found.ok());
  CHECK(found->fps == 25);
  CHECK(found->metric);
  CHECK(found->split_known == capture->split_known);
  REQUIRE(found->cameras.size() == kCameras);
  for (int i = 0; i < kCameras; ++i) {
    const SourceCamera &a = capture->cameras[i], &b = found->cameras[i];
    CHECK(a.name == b.name);
    CHECK(a.lens == b.lens);
    CHECK(a.distortion == b.distortion);
    CHECK(a.fx == b.fx);
    CHECK(a.cx == b.cx);
    CHECK(a.width == b.width);
    CHECK(a.height == b.height);
    for (int k = 0; k < 9; ++k) CHECK(a.rotation[k] == Approx(b.rotation[k]).margin(1e-12));
    for (int k = 0; k < 3; ++k) CHECK(a.translation[k] == b.translation[k]);
  }
}

}  // namespace
}  // namespace stgs::encoder::capture_test
