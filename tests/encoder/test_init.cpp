// SPDX-License-Identifier: Apache-2.0
#include "fixtures/loop_threads.h"
#include "init/init.h"
#include "stgs/encoder/capture_folder.h"

#include <fstream>
#include <sstream>

#include "catch.h"
#include "fixtures/synthetic_rig.h"
#include "fixtures/temporary_folder.h"
#include "init/motion.h"

namespace stgs::encoder {
namespace {

using testing::TemporaryFolder;

InitSettings quick() {
  InitSettings settings;
  settings.write_report = false;
  settings.max_static_points = 3000;
  settings.max_dynamic_points = 400;
  return settings;
}

Status run(PreparedCapture& capture, const InitSettings& settings = quick()) {
  return initialise(capture, settings, {},
                    [](int, const std::string& line) { UNSCOPED_INFO(line); });
}

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// Everything that the initialisation of `capture` writes for training.
std::string result_of(const PreparedCapture& capture) {
  std::string all = bytes_of(capture.folder + "/points_static.ply") +
                    bytes_of(capture.folder + "/points_dynamic.ply");
  for (const Camera& camera : capture.cameras) {
    for (int f = 0; f < capture.frames; ++f) all += bytes_of(capture.mask_path(camera, f));
  }
  return all + fmt::format("{} {} {}", capture.near_plane, capture.scene_radius, capture.extent);
}

std::vector<InitialPoint> points_of(const PreparedCapture& capture, const char* name) {
  auto points = read_points(capture.folder + "/" + name);
  REQUIRE(points.ok());
  return *points;
}

cv::Vec3d position_of(const InitialPoint& p) {
  return {p.position[0], p.position[1], p.position[2]};
}

TEST_CASE("a moving ball is masked, located and given its velocity; the rest is static") {
  const TemporaryFolder folder;
  const SyntheticRig rig;
  // With 7 cameras, rounding in stereo decides whether flow explains the motion better.
  PreparedCapture capture = rig.write(folder.path, 10);
  const Status status = run(capture);
  INFO(status.message());
  REQUIRE(status.ok());

  double both = 0, either = 0;
  for (const Camera& camera : capture.cameras) {
    if (camera.test) continue;
    for (int f = 0; f < capture.frames; ++f) {
      const auto mask = load_mask(capture, camera, f);
      REQUIRE(mask.ok());
      REQUIRE(mask->data.size() == 160u * 120u);
      cv::Mat expected;
      (void)rig.render(camera, f, &expected);
      const cv::Mat found(120, 160, CV_8U, const_cast<std::uint8_t*>(mask->data.data()));
      both += cv::countNonZero((found >= 128) & expected);
      either += cv::countNonZero((found >= 128) | expected);
    }
  }
  CHECK(both / either > 0.7);

  const auto dynamic_points = points_of(capture, "points_dynamic.ply");
  std::vector<int> counts(capture.frames, 0);
  int near = 0;
  cv::Vec3d mean(0, 0, 0);
  for (const InitialPoint& p : dynamic_points) {
    REQUIRE(p.frame >= 0);
    REQUIRE(p.frame < capture.frames);
    ++counts[p.frame];
    // 0.1 m is 0.7 pixels of disparity between neighbouring cameras.
    if (rig.from_ball(position_of(p), p.frame) >= 0.1) continue;
    ++near;
    mean += cv::Vec3d(p.velocity[0], p.velocity[1], p.velocity[2]);
  }
  for (const int count : counts) {
    CHECK(count > 80);
    CHECK(count <= 400);
  }
  CHECK(near > 0.75 * double(dynamic_points.size()));
  mean *= 1.0 / std::max(1, near);
  INFO("mean velocity " << mean[0] << " " << mean[1] << " " << mean[2]);
  CHECK(cv::norm(mean - rig.velocity) < 0.25 * cv::norm(rig.velocity));

  const auto static_points = points_of(capture, "points_static.ply");
  CHECK(static_points.size() > 1000);
  CHECK(static_points.size() <= 3000);
  int on_surface = 0;
  for (const InitialPoint& p : static_points) {
    CHECK(p.frame == -1);
    if (SyntheticRig::from_static(position_of(p)) < 0.12) ++on_surface;
  }
  CHECK(on_surface > 0.8 * double(static_points.size()));

  CHECK(capture.near_plane > 0.2);
  CHECK(capture.near_plane < 1.8);
  CHECK(capture.scene_radius > 0.5);
  CHECK(capture.scene_radius < 5);
}

TEST_CASE("held-out cameras are never read, and the number of threads does not change the result") {
  const TemporaryFolder clean, poisoned;
  SyntheticRig rig;
  rig.frames = 3;
  PreparedCapture a = rig.write(clean.path, 5), b = rig.write(poisoned.path, 5);
  for (const Camera& camera : b.cameras) {
    if (!camera.test) continue;
    for (int f = 0; f < b.frames; ++f) {
      std::ofstream(b.frame_path(camera, f)) << "not an image";
    }
  }
  REQUIRE(run(a).ok());
  const testing::LoopThreads one_thread(1);
  REQUIRE(run(b).ok());
  CHECK(result_of(a) == result_of(b));
  InitSettings other_seed = quick();
  other_seed.seed = 2;
  REQUIRE(run(b, other_seed).ok());
  CHECK(result_of(a) != result_of(b));
  for (const Camera& camera : a.cameras) {
    CHECK(std::filesystem::exists(a.mask_path(camera, 0)) == !camera.test);
  }
}

TEST_CASE("a camera whose calibration disagrees gives no points") {
  const TemporaryFolder with, without;
  SyntheticRig rig;
  rig.frames = 3;
  PreparedCapture a = rig.write(with.path, 9), b = rig.write(without.path, 9);
  constexpr std::size_t kMoved = 2;
  REQUIRE_FALSE(a.cameras[kMoved].test);
  a.cameras[kMoved].translation[0] += 0.3;
  a.cameras[kMoved].translation[2] -= 0.5;  // into the scene
  b.cameras[kMoved].test = true;
  std::string log;
  REQUIRE(
      initialise(a, quick(), {}, [&](int, const std::string& line) { log += line + "\n"; }).ok());
  REQUIRE(run(b).ok());
  INFO(log);
  REQUIRE(log.find("camera '" + a.cameras[kMoved].name + "' disagrees") != std::string::npos);
  for (const char* name : {"points_static.ply", "points_dynamic.ply"}) {
    CHECK(points_of(a, name).size() > 100);
    CHECK(bytes_of(a.folder + "/" + name) == bytes_of(b.folder + "/" + name));
  }
  CHECK(a.near_plane == b.near_plane);
  CHECK(a.extent == b.extent);
}

TEST_CASE("minimal captures still get initial points") {
  const TemporaryFolder folder;
  SyntheticRig rig;
  rig.frames = 2;
  const auto expect_static = [&](int cameras) {
    PreparedCapture capture = rig.write(folder.path, cameras);
    const Status status = run(capture);
    INFO(status.message());
    REQUIRE(status.ok());
    CHECK(points_of(capture, "points_dynamic.ply").empty());
    CHECK(points_of(capture, "points_static.ply").size() > 50);
    CHECK(capture.near_plane > 0);
  };
  SECTION("a static scene") {
    rig.ball = false;
    expect_static(4);
  }
  SECTION("a single frame") {
    rig.frames = 1;
    expect_static(4);
  }
  SECTION("a single camera") {
    rig.ball = false;
    expect_static(1);
  }
  SECTION("two cameras of different resolution") {
    rig.frames = 4;
    PreparedCapture capture = rig.write(folder.path, 2);
    Camera& small = capture.cameras[1];
    small.width = 120;
    small.height = 90;
    small.fx = small.fy = 105;
    small.cx = 60;
    small.cy = 45;
    for (int f = 0; f < rig.frames; ++f) {
      REQUIRE(init::write_png(capture.frame_path(small, f), rig.render(small, f, nullptr)).ok());
    }
    const Status status = run(capture);
    INFO(status.message());
    REQUIRE(status.ok());
    CHECK(points_of(capture, "points_dynamic.ply").size() > 50);
  }
  SECTION("masks that cover every pixel") {
    PreparedCapture capture = rig.write(folder.path, 4);
    for (const Camera& camera : capture.cameras) {
      std::filesystem::create_directories(folder / "masks/" + camera.name);
      for (int f = 0; f < rig.frames; ++f) {
        const cv::Mat all(camera.height, camera.width, CV_8U, cv::Scalar(255));
        REQUIRE(init::write_png(capture.mask_path(camera, f), all).ok());
      }
    }
    const Status status = run(capture);
    INFO(status.message());
    REQUIRE(status.ok());
    CHECK(points_of(capture, "points_dynamic.ply").size() > 50);
  }
}

TEST_CASE("without motion separation there is one static cloud") {
  const TemporaryFolder folder;
  SyntheticRig rig;
  rig.frames = 2;
  PreparedCapture capture = rig.write(folder.path, 5);
  InitSettings settings = quick();
  settings.separate_motion = false;
  REQUIRE(run(capture, settings).ok());
  CHECK(points_of(capture, "points_dynamic.ply").empty());
  const auto points = points_of(capture, "points_static.ply");
  int on_ball = 0;
  for (const InitialPoint& p : points) {
    CHECK(p.frame == -1);
    if (rig.from_ball(position_of(p), 0) < 0.07) ++on_ball;
  }
  CHECK(on_ball > 30);
  CHECK_FALSE(std::filesystem::exists(folder / "masks"));
}

TEST_CASE("the error names the frame that cannot be read") {
  const TemporaryFolder folder;
  SyntheticRig rig;
  rig.frames = 2;
  PreparedCapture capture = rig.write(folder.path, 4);
  std::ofstream(capture.frame_path(capture.cameras[1], 1)) << "not an image";
  const Status status = run(capture);
  CHECK_FALSE(status.ok());
  CHECK(status.message().find("c1/000001.png") != std::string::npos);
}

TEST_CASE("initialisation can be cancelled") {
  const TemporaryFolder folder;
  SyntheticRig rig;
  rig.frames = 1;
  PreparedCapture capture = rig.write(folder.path, 3);
  const Status status = initialise(capture, quick(), [](const Progress&) { return false; }, {});
  CHECK_FALSE(status.ok());
  CHECK(status.message().find("cancelled") != std::string::npos);
}

TEST_CASE("invalid flow files are rejected") {
  const TemporaryFolder folder;
  const std::string path = folder / "a.flo";
  const auto files = *CaptureFolder::open(folder.path, false);
  const auto write = [&](float magic, std::int32_t width, std::int32_t height, int floats) {
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(&magic), 4);
    file.write(reinterpret_cast<const char*>(&width), 4);
    file.write(reinterpret_cast<const char*>(&height), 4);
    for (int i = 0; i < floats; ++i) {
      const float value = float(i);
      file.write(reinterpret_cast<const char*>(&value), 4);
    }
  };
  write(202021.25f, 3, 2, 12);
  const auto good = init::read_flow(*files, path);
  REQUIRE(good.ok());
  CHECK(good->at<cv::Vec2f>(1, 2) == cv::Vec2f(10, 11));
  write(202021.25f, 3, 2, 11);
  CHECK(init::read_flow(*files, path).status().message().find("truncated") != std::string::npos);
  write(202021.25f, 30000, 30000, 12);
  CHECK_FALSE(init::read_flow(*files, path).ok());
  write(1.0f, 3, 2, 12);
  CHECK_FALSE(init::read_flow(*files, path).ok());
  write(202021.25f, -3, 2, 12);
  CHECK_FALSE(init::read_flow(*files, path).ok());
  CHECK_FALSE(init::read_flow(*files, folder / "none.flo").ok());
}

}  // namespace
}  // namespace stgs::encoder
