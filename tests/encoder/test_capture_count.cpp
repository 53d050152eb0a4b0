// SPDX-License-Identifier: Apache-2.0
// Captures with too few cameras to triangulate depth are rejected before any work.
#include "capture_fixture.h"

#include "catch.h"

namespace stgs::encoder::capture_test {
namespace {

// Cameras cam0, cam1, ... with image folders and a cameras.json.
void write_cameras(const TemporaryFolder& folder, int count) {
  std::string list;
  for (int i = 0; i < count; ++i) {
    const Camera c = known_camera(i, 3, "");
    list += fmt::format("{}\"cam{}\":{{\"K\":{},\"w2c\":{}}}", i == 0 ? "" : ",", i,
                        json_list(matrix_k(c)), json_list(world_to_camera(c)));
    write_images(folder / fmt::format("images/cam{}", i), i, 2);
  }
  write_text(folder / "cameras.json", "{" + list + "}");
}

TEST_CASE("a capture of one camera is rejected and leaves nothing behind") {
  const TemporaryFolder folder;
  write_cameras(folder, 1);
  const Status status = prepare(folder.path, folder / "out", {}, {}, {});
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"only 1 camera ('cam0')", "at least 2 cameras"}));
  CHECK_FALSE(fs::exists(folder / "out"));
}

TEST_CASE("a single uncalibrated camera is rejected, with layout detection and as layout videos") {
  const TemporaryFolder folder;
  write_video(folder / "videos/left.mp4", 0, 2);
  PrepareSettings settings;
  settings.layout = GENERATE(Layout::kAuto, Layout::kVideos);
  const Status status = load(folder.path, settings).status();
  CHECK(status.code() == StatusCode::kInvalidFile);
  CHECK(fails_with(status, {"only 1 camera ('left')", "at least 2 cameras"}));
}

TEST_CASE("held-out cameras must leave at least two for training") {
  const TemporaryFolder folder;
  write_cameras(folder, 3);
  const auto planned = [&](std::vector<std::string> held_out) {
    PrepareSettings settings;
    settings.test_cameras = std::move(held_out);
    PreparedCapture prepared;
    const auto source = load(folder.path, settings);
    return plan_frames(*source, settings, prepared, [](int, const std::string&) {}).status();
  };
  CHECK(planned({"cam1"}).ok());
  const Status status = planned({"cam0", "cam1"});
  CHECK(status.code() == StatusCode::kUsage);
  CHECK(fails_with(status, {"1 camera left", "holding out 2", "--test-cameras"}));
  CHECK(fails_with(planned({"cam0", "cam1", "cam2"}), {"0 cameras left", "holding out 3"}));
}

}  // namespace
}  // namespace stgs::encoder::capture_test
