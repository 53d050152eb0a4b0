// SPDX-License-Identifier: Apache-2.0
// Preparing and measuring by the protocols of the paper, on captures in the layouts of its data.
#include <algorithm>

#include "capture_fixture.h"
#include "catch.h"
#include "stgs/encoder/protocol.h"

namespace stgs::encoder::capture_test {
namespace {

// Plans the preparation of a folder by a protocol.
Result<PreparedCapture> plan(const std::string& folder, const std::string& name, double scale = 0) {
  PrepareSettings settings;
  STGS_TRY(apply_protocol(*find_protocol(name), scale, settings));
  std::optional<PreparedCapture> planned;
  settings.accept = [&planned](const PreparedCapture& capture) {
    planned = capture;
    return runtime_error("planned");
  };
  const testing::TemporaryFolder out;
  const Status status = prepare(folder, out / "out", settings, {}, [](int, const std::string&) {});
  if (planned) return *planned;
  return status;
}

std::vector<std::string> held_out(const PreparedCapture& capture) {
  std::vector<std::string> names;
  for (const Camera& camera : capture.cameras) {
    if (camera.test) names.push_back(camera.name);
  }
  return names;
}

TEST_CASE("n3dv: the first 300 frames at half size, without cam00") {
  const TemporaryFolder folder;
  write_n3dv(folder.path, 3, 305);
  const auto capture = plan(folder.path, "n3dv");
  INFO(capture.status().message());
  REQUIRE(capture.ok());
  CHECK(capture->frames == 300);
  CHECK(capture->first_frame == 0);
  CHECK(capture->cameras[0].width == kWidth / 2);
  CHECK(capture->cameras[0].height == kHeight / 2);
  CHECK(held_out(*capture) == std::vector<std::string>{"cam00"});
  CHECK(check_protocol(*find_protocol("n3dv"), *capture).ok());
  CHECK(check_protocol(*find_protocol("selfcap"), *capture).message().find("but by n3dv") !=
        std::string::npos);
  PreparedCapture part = *capture;
  part.frames = 30;
  CHECK(check_protocol(*find_protocol("n3dv"), part).message().find("30 of 300 frames") !=
        std::string::npos);
  PreparedCapture late = *capture;
  late.first_frame = 1;
  CHECK(check_protocol(*find_protocol("n3dv"), late).code() == StatusCode::kUsage);
  PreparedCapture changed = *capture;
  std::swap(changed.cameras[0].test, changed.cameras[1].test);
  CHECK(check_protocol(*find_protocol("n3dv"), changed).code() == StatusCode::kInvalidFile);
  PreparedCapture other = *capture;
  other.protocol.clear();
  CHECK(check_protocol(*find_protocol("n3dv"), other).code() == StatusCode::kUsage);

  const Status scaled = plan(folder.path, "n3dv", 0.25).status();
  CHECK(scaled.code() == StatusCode::kUsage);
  CHECK(scaled.message().find("have the scale 0.5; remove --scale") != std::string::npos);
}

TEST_CASE("enerf-outdoor and selfcap: cameras number 9 and 10 of EasyVolcap's, their scales") {
  const TemporaryFolder folder;
  write_easyvolcap(folder, 11, 300, true);
  const auto outdoor = plan(folder.path, "enerf-outdoor");
  INFO(outdoor.status().message());
  REQUIRE(outdoor.ok());
  CHECK(outdoor->frames == 300);
  CHECK(outdoor->cameras[0].width == kWidth);
  CHECK(held_out(*outdoor) == std::vector<std::string>{"08"});
  for (double scale : {0.0, 0.5, 1.0}) {
    const auto selfcap = plan(folder.path, "selfcap", scale);
    REQUIRE(selfcap.ok());
    CHECK(selfcap->frames == 60);
    CHECK(selfcap->cameras[0].width == (scale == 1.0 ? kWidth : kWidth / 2));
    CHECK(held_out(*selfcap) == std::vector<std::string>{"09"});
  }
}

TEST_CASE("a capture that a protocol does not fit is named with the reason") {
  const TemporaryFolder folder;
  write_easyvolcap(folder, 8, 60, true);
  const Status few = plan(folder.path, "selfcap").status();
  CHECK(few.code() == StatusCode::kInvalidFile);
  CHECK(few.message().find("has 8 cameras, but protocol selfcap holds out camera number 10") !=
        std::string::npos);
  const TemporaryFolder short_clip;
  write_n3dv(short_clip.path, 3, 20);
  const Status too_short = plan(short_clip.path, "n3dv").status();
  CHECK(too_short.message().find("protocol n3dv needs the first 300 frames, but camera 'cam00' has "
                                 "20") != std::string::npos);
  PrepareSettings unknown;
  unknown.protocol = "n3d";
  CHECK(load(short_clip.path, unknown).status().code() == StatusCode::kUsage);
  CHECK_FALSE(plan(short_clip.path, "selfcap").ok());  // another layout
}

}  // namespace
}  // namespace stgs::encoder::capture_test
