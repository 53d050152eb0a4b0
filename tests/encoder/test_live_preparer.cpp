// SPDX-License-Identifier: Apache-2.0
// A rig that the application calibrates is the same as one in a file.
#include "stgs/encoder/live_preparer.h"

#include <algorithm>
#include <fstream>
#include <vector>

#include "catch.h"
#include "fixtures/temporary_folder.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

constexpr int kWidth = 60, kHeight = 40;
constexpr double kFps = 25;

std::vector<RigCamera> calibration() {
  RigCamera left;
  left.name = "left";
  left.width = kWidth;
  left.height = kHeight;
  left.fx = 50;
  left.fy = 52;
  left.cx = 31;
  left.cy = 19.5;
  left.distortion = {0.1, -0.02, 0.003, -0.001, 0.01};
  left.world_to_camera = {1, 0, 0, 0.25, 0, 1, 0, -0.5, 0, 0, 1, 2};
  RigCamera right = left;
  right.name = "right";
  right.width = right.height = 0;
  right.fisheye = true;
  right.distortion = {0.05, -0.01, 0.002, 0.001};
  right.world_to_camera = {0, 0, 1, 1, 0, 1, 0, 0, -1, 0, 0, 3};
  return {left, right};
}

// The same cameras, in a file.
constexpr const char* kFile = R"({"fps": 25, "cameras": [
  {"name": "left", "K": [[50, 0, 31], [0, 52, 19.5], [0, 0, 1]], "width": 60, "height": 40,
   "dist": [0.1, -0.02, 0.003, -0.001, 0.01],
   "w2c": [[1, 0, 0, 0.25], [0, 1, 0, -0.5], [0, 0, 1, 2]]},
  {"name": "right", "K": [[50, 0, 31], [0, 52, 19.5], [0, 0, 1]], "fisheye": true,
   "dist": [0.05, -0.01, 0.002, 0.001],
   "w2c": [[0, 0, 1, 1], [0, 1, 0, 0], [-1, 0, 0, 3]]}]})";

// An image of `channels` channels in RGB or BGR order; alpha varies.
std::vector<std::uint8_t> pixels(int channels, bool bgr) {
  std::vector<std::uint8_t> out;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const int rgb[3] = {4 * x, 6 * y, x + y};
      for (int c = 0; c < 3; ++c) out.push_back(static_cast<std::uint8_t>(rgb[bgr ? 2 - c : c]));
      if (channels == 4) out.push_back(static_cast<std::uint8_t>(x * y));
    }
  }
  return out;
}

Image8 converted(LivePreparer& rig, std::size_t camera, int channels, bool bgr) {
  const std::vector<std::uint8_t> data = pixels(channels, bgr);
  LiveImage image;
  image.data = data.data();
  image.width = kWidth;
  image.height = kHeight;
  image.stride = static_cast<std::size_t>(channels) * kWidth;
  image.bgr = bgr;
  image.has_alpha = channels == 4;
  auto frame = rig.convert(camera, image);
  INFO(frame.status().message());
  REQUIRE(frame.ok());
  return std::move(*frame);
}

}  // namespace

TEST_CASE("a given calibration prepares images like a rig file, in any channel order") {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "rig.json") << kFile;
  auto file = LivePreparer::open(folder / "rig.json", {}, 0, nullptr);
  auto given = LivePreparer::open(calibration(), {}, kFps);
  INFO(file.status().message() << given.status().message());
  REQUIRE(file.ok());
  REQUIRE(given.ok());
  CHECK((*given)->fps() == (*file)->fps());
  for (const std::size_t camera : {0, 1}) {
    const Image8 expected = converted(**file, camera, 3, false);
    for (const int channels : {3, 4})
      for (const bool bgr : {false, true})
        CHECK(converted(**given, camera, channels, bgr).data == expected.data);
  }
  const auto from_file = (*file)->start({true, true}), from_given = (*given)->start({true, true});
  REQUIRE(from_file.ok());
  REQUIRE(from_given.ok());
  REQUIRE(from_given->cameras.size() == 2);
  for (std::size_t i = 0; i < 2; ++i) {
    const Camera &a = from_file->cameras[i], &b = from_given->cameras[i];
    CHECK(a.name == b.name);
    CHECK((a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy));
    CHECK(std::equal(a.rotation, a.rotation + 9, b.rotation));
    CHECK(std::equal(a.translation, a.translation + 3, b.translation));
  }
}

TEST_CASE("a given calibration has no sources") {
  const auto rig = LivePreparer::open(calibration(), {}, kFps);
  REQUIRE(rig.ok());
  CHECK((*rig)->check_sources().code() == StatusCode::kUsage);
  CHECK((*rig)
            ->read_source(
                0, [](std::size_t, double, const Image8&) {}, [] { return false; }, nullptr)
            .code() == StatusCode::kUsage);
}

TEST_CASE("an incomplete calibration is an error of the call") {
  std::vector<RigCamera> one = calibration(), nan = one;
  one.pop_back();
  CHECK(LivePreparer::open(one, {}, kFps).status().code() == StatusCode::kUsage);
  nan[1].fx = -1;
  CHECK(LivePreparer::open(nan, {}, kFps).status().code() == StatusCode::kUsage);
  CHECK(LivePreparer::open(calibration(), {}, 0).status().code() == StatusCode::kUsage);
}
