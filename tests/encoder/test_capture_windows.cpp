// SPDX-License-Identifier: Apache-2.0
// Captures that are prepared window by window.
#include "capture_fixture.h"
#include "catch.h"
#include "stgs/encoder/frame_memory.h"
#include "stgs/encoder/prepare.h"

namespace stgs::encoder::capture_test {
namespace {

using Spans = std::vector<FrameSpan>;

std::unique_ptr<WindowPreparer> open(const std::string& capture, const PrepareSettings& settings,
                                     int window) {
  auto preparer = WindowPreparer::open(capture, settings, window, {}, {});
  INFO(preparer.status().message());
  REQUIRE(preparer.ok());
  return std::move(*preparer);
}

PreparedCapture prepared(WindowPreparer& preparer, std::size_t index, const std::string& folder) {
  const Status status = preparer.prepare(index, folder, true, {}, {}).status();
  INFO(status.message());
  REQUIRE(status.ok());
  auto capture = read_prepared_capture(folder);
  REQUIRE(capture.ok());
  return std::move(*capture);
}

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

TEST_CASE("captures are cut into windows of similar length") {
  CHECK(cut_into_windows(10, 0) == Spans{{0, 10}});
  CHECK(cut_into_windows(10, 20) == Spans{{0, 10}});
  CHECK(cut_into_windows(20, 10) == Spans{{0, 10}, {10, 20}});
  CHECK(cut_into_windows(24, 10) == Spans{{0, 10}, {10, 24}});
  CHECK(cut_into_windows(25, 10) == Spans{{0, 10}, {10, 20}, {20, 25}});
  CHECK(cut_into_windows(3, 1) == Spans{{0, 1}, {1, 2}, {2, 3}});
}

TEST_CASE("long captures have windows of two seconds by default") {
  CHECK(default_window(300, {1, 30}) == 0);
  CHECK(default_window(301, {1, 30}) == 60);
  CHECK(default_window(1000, {1001, 30000}) == 60);
  CHECK(default_window(100000, {1, 240}) == 300);
  CHECK(default_window(301, {1, 1}) == 8);
}

TEST_CASE("windows have the frames of the capture and the bounds of the first window") {
  const TemporaryFolder folder;
  write_n3dv(folder / "in", 4, 9);
  PrepareSettings settings;
  REQUIRE(prepare(folder / "in", folder / "whole", settings, {}, {}).ok());
  const auto whole = read_prepared_capture(folder / "whole");
  REQUIRE(whole.ok());

  const auto in_order = open(folder / "in", settings, 4);
  CHECK(in_order->windows() == Spans{{0, 4}, {4, 9}});
  const PreparedCapture first = prepared(*in_order, 0, folder / "first");
  const PreparedCapture second = prepared(*in_order, 1, folder / "second");
  CHECK(first.frames == 4);
  CHECK(second.first_frame == 4);
  CHECK(second.frames == 5);
  CHECK(second.near_plane == first.near_plane);
  CHECK(second.extent == first.extent);
  CHECK(second.scene_radius == first.scene_radius);
  CHECK_FALSE(read_points(folder / "first/points_static.ply")->empty());
  CHECK(bytes_of(folder / "second/points_static.ply") ==
        bytes_of(folder / "first/points_static.ply"));
  CHECK_FALSE(fs::exists(folder / "second/report"));
  for (int f = 0; f < 5; ++f) {
    CHECK(load_frame(second, second.cameras[1], f)->data ==
          load_frame(*whole, whole->cameras[1], 4 + f)->data);
    CHECK(has_mask(second, second.cameras[1], f));
  }

  // Another object analyses the first window again, and finds the same.
  const auto alone = open(folder / "in", settings, 4);
  CHECK(prepared(*alone, 1, folder / "alone").scene_radius == first.scene_radius);
  for (const char* name : {"points_dynamic.ply", "frames/cam01/000004.png", "capture.json"})
    CHECK(bytes_of(folder / "alone/" + name) == bytes_of(folder / "second/" + name));
}

TEST_CASE("a later window is prepared from the stored analysis of the first") {
  const TemporaryFolder folder;
  write_n3dv(folder / "in", 4, 8);
  const std::string file = folder / "first.analysis";
  const auto in_order = open(folder / "in", {}, 4);
  in_order->keep_analysis(file);
  (void)prepared(*in_order, 0, folder / "first");
  (void)prepared(*in_order, 1, folder / "second");

  // Whether the first window was analysed, and the result of preparing the second alone.
  bool analysed = false;
  const auto prepare_alone = [&](const PrepareSettings& settings, const std::string& name) {
    const auto alone = open(folder / "in", settings, 4);
    alone->keep_analysis(file);
    analysed = false;
    return alone
        ->prepare(1, folder / name, true, {},
                  [&](int, const std::string& line) {
                    analysed = analysed || line.find("analysing the first") != std::string::npos;
                  })
        .status();
  };
  REQUIRE(prepare_alone({}, "alone").ok());
  CHECK_FALSE(analysed);
  for (const char* name : {"points_static.ply", "points_dynamic.ply", "capture.json"})
    CHECK(bytes_of(folder / "alone/" + name) == bytes_of(folder / "second/" + name));

  PrepareSettings other;
  other.max_static_points = 50;
  CHECK(prepare_alone(other, "other").code() == StatusCode::kUsage);
  const std::string intact = bytes_of(file);
  const auto damage = [&](std::string bytes) {
    std::ofstream(file, std::ios::binary) << bytes;
    const Status status = prepare_alone({}, "damaged");
    CHECK(status.code() == StatusCode::kInvalidFile);
    CHECK(status.message().find("remove it") != std::string::npos);
    CHECK_FALSE(fs::exists(folder / "damaged"));
  };
  damage(intact.substr(0, intact.size() / 2));
  damage("");
  std::string changed = intact;
  changed[changed.size() / 2] = static_cast<char>(changed[changed.size() / 2] ^ 1);
  damage(changed);
  fs::remove(file);
  REQUIRE(prepare_alone({}, "again").ok());
  CHECK(analysed);
  CHECK(bytes_of(file) == intact);
}

TEST_CASE("a window in memory has no image files, and has given masks as they are") {
  const TemporaryFolder folder;
  write_n3dv(folder / "in", 4, 6);
  cv::Mat mask = cv::Mat::zeros(kHeight, kWidth, CV_8UC1);
  mask.colRange(0, kWidth / 2).setTo(255);
  for (int f = 0; f < 6; ++f)
    write_image(fmt::format("{}/in/masks/cam02/{:06}.png", folder.path, f), mask);
  const auto in_files = open(folder / "in", {}, 3), in_memory = open(folder / "in", {}, 3);
  for (std::size_t i = 0; i < 2; ++i) {
    const std::string files = fmt::format("{}/files{}", folder.path, i),
                      memory = fmt::format("{}/memory{}", folder.path, i);
    (void)prepared(*in_files, i, files);
    const auto expected = read_prepared_capture(files);
    REQUIRE(expected.ok());
    const auto found = in_memory->prepare(i, memory, false, {}, {});
    REQUIRE(found.ok());
    CHECK(found->memory_only);
    CHECK_FALSE(fs::exists(memory + "/frames"));
    CHECK_FALSE(fs::exists(memory + "/masks"));
    for (const Camera& camera : found->cameras) {
      for (int f = 0; f < 3; ++f) {
        CHECK(load_frame(*found, camera, f)->data == load_frame(*expected, camera, f)->data);
        if (!camera.test) CHECK(has_mask(*found, camera, f));
        CHECK(load_mask(*found, camera, f)->data == load_mask(*expected, camera, f)->data);
      }
    }
    const auto copied = load_mask(*found, found->cameras[2], 1);
    CHECK(int(copied->data[0]) == 255);
    CHECK(int(copied->data[kWidth - 1]) == 0);
    // Writing the points of the memory gives the same files.
    const auto points = found->memory->points();
    REQUIRE(points != nullptr);
    CHECK_FALSE(points->statics.empty());
    REQUIRE(write_points(memory + "/statics.ply", points->statics).ok());
    REQUIRE(write_points(memory + "/dynamics.ply", points->dynamics).ok());
    CHECK(bytes_of(memory + "/statics.ply") == bytes_of(files + "/points_static.ply"));
    CHECK(bytes_of(memory + "/dynamics.ply") == bytes_of(files + "/points_dynamic.ply"));
  }
}

TEST_CASE("windows need dynamic points, and their identity depends on settings and files") {
  const TemporaryFolder folder;
  write_n3dv(folder / "in", 3, 6);
  PrepareSettings settings;
  const auto identity = [&](int window = 3) {
    const auto found = open(folder / "in", settings, window)->identity();
    REQUIRE(found.ok());
    return *found;
  };
  const std::string before = identity();
  CHECK(identity() == before);
  CHECK(identity(2) != before);
  settings.seed = 2;
  CHECK(identity() != before);
  settings = {};
  settings.scale = 0.5;
  CHECK(identity() != before);
  settings = {};
  write_video(folder / "in/cam01.mp4", 1, 6);
  CHECK(identity() != before);
  settings.separate_motion = false;
  CHECK(open(folder / "in", settings, 0)->windows().size() == 1);
  const Status status = WindowPreparer::open(folder / "in", settings, 2, {}, {}).status();
  CHECK(status.code() == StatusCode::kUsage);
  CHECK(status.message().find("--no-split") != std::string::npos);
}

}  // namespace stgs::encoder::capture_test
