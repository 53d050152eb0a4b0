// SPDX-License-Identifier: Apache-2.0
// The work per window, and the size of its images, with which encoding keeps up.
#include "stream/live_controller.h"

#include <cmath>
#include <vector>

#include "catch.h"
#include "stgs/encoder/frame_memory.h"
#include "stream/live_capture.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

constexpr int kWindow = 15, kMinSteps = 60;
constexpr double kWindowSeconds = 0.5;

// A machine that encodes windows without a backlog.
struct Machine {
  double least_seconds;      // of training with the least steps, at full size
  double cost = 3;           // of a size over half of it
  double fixed_share = 0.2;  // of the least time, which does not depend on the steps
  double noise = 0.05;       // of the durations
  LiveController controller{30, 1.5, 900};

  Machine(double seconds, int max_halvings = kMaxHalvings) : least_seconds(seconds) {
    controller.limit_halvings(max_halvings);
  }
  // Encodes a window; returns how often its images are halved.
  int encode(int ready = 0, bool overflowed = false) {
    const int halvings = controller.choose_halvings(ready, overflowed);
    const int steps = controller.iterations(kWindow, 0);
    controller.prepared(halvings, kWindow, controller.point_interval(kWindow, 0), 0.01);
    noise = -noise;
    controller.trained(halvings, kWindow, steps, (1 + noise) * seconds(halvings, steps));
    return halvings;
  }
  int encode_many(int windows, int ready = 0) {
    int halvings = 0;
    for (int i = 0; i < windows; ++i) halvings = encode(ready);
    return halvings;
  }

 private:
  double seconds(int halvings, int steps) const {
    return least_seconds / std::pow(cost, halvings) *
           (fixed_share + (1 - fixed_share) * steps / kMinSteps);
  }
};

}  // namespace

TEST_CASE("the primitives that remain follow the limit of the bit rate") {
  LiveController controller(30, 1.5, 900);
  const double largest = controller.keep();
  // 120 kB per window of 15 frames with all primitives, or 1,920 kbit/s.
  const auto bytes = [&] { return 120e3 * controller.keep(); };
  for (int i = 0; i < 30; ++i) CHECK(controller.wrote(15, bytes(), 4000));
  CHECK(controller.keep() == largest);
  for (int i = 0; i < 30; ++i) CHECK(controller.wrote(15, bytes(), 800));
  CHECK(bytes() == Approx(50e3).epsilon(0.02));
  // Content that takes more.
  for (int i = 0; i < 30; ++i) CHECK(controller.wrote(15, 2 * bytes(), 800));
  CHECK(2 * bytes() == Approx(50e3).epsilon(0.02));
  // The limit cannot be reached; a higher one can again.
  bool possible = true;
  for (int i = 0; i < 30; ++i) possible = controller.wrote(15, bytes(), 100);
  CHECK_FALSE(possible);
  CHECK(controller.keep() > 0.05);
  for (int i = 0; i < 30; ++i) controller.wrote(15, bytes(), 4000);
  CHECK(controller.keep() == largest);
}

TEST_CASE("the work per window follows from its time") {
  LiveController controller(30, 1.5, 900);
  CHECK(controller.window() == 15);
  CHECK(controller.frames(3) == 15);
  CHECK(controller.frames(40) == 40);
  CHECK(controller.frames(1000) == 60);
  // A machine that needs 0.1 s, and 0.07 s per frame with points; 0.15 s, and 1 ms per iteration.
  controller.first_trained(3000, 3);
  for (int i = 0; i < 100; ++i) {
    const int interval = controller.point_interval(15, 0), steps = controller.iterations(15, 0);
    controller.prepared(0, 15, interval, 0.1 + 0.07 * (15 / interval));
    controller.trained(0, 15, steps, 0.15 + 0.001 * steps);
  }
  // 90 % of the 0.5 s that a window lasts.
  CHECK(controller.point_interval(15, 0) >= 3);
  CHECK(controller.point_interval(15, 0) <= 4);
  CHECK(controller.iterations(15, 0) == Approx(300).margin(10));
  // More frames have more time, up to the work of the preset.
  CHECK(controller.iterations(22, 0) > 400);
  CHECK(LiveController(30, 1.5, 200).iterations(22, 0) == 200);
  // With a backlog, or a long window that results from one, less than in the time of the window.
  CHECK(controller.iterations(22, 30) < 100);
  CHECK(controller.iterations(60, 0) < 450);
  CHECK(controller.point_interval(22, 30) > controller.point_interval(22, 0));
  // A machine that is too slow does the least.
  for (int i = 0; i < 40; ++i) {
    controller.prepared(0, 15, 15, 5);
    controller.trained(0, 15, 60, 60);
  }
  CHECK(controller.point_interval(15, 0) == 15);
  CHECK(controller.iterations(15, 0) == 60);
}

TEST_CASE("images remain at full size while there is time for the least work") {
  Machine machine(0.4);
  for (int i = 0; i < 100; ++i) CHECK(machine.encode() == 0);
  // Dropped images alone are no reason: a disk may have stalled.
  CHECK(machine.encode(0, true) == 0);
}

TEST_CASE("images become smaller until the least work fits in the time, and remain so") {
  Machine slow(1.2);
  int changes = 0, before = 0;
  for (int i = 0; i < 300; ++i) {
    const int halvings = slow.encode();
    changes += halvings != before ? 1 : 0;
    before = halvings;
  }
  CHECK(before == 1);
  CHECK(changes == 1);
  CHECK(Machine(3).encode_many(50) == 2);
  // A machine that is still too slow, and rigs whose images are small.
  CHECK(Machine(100).encode_many(50) == 2);
  CHECK(Machine(100, 1).encode_many(50) == 1);
  CHECK(Machine(100, 0).encode_many(50) == 0);
  CHECK(LiveController(30, 1.5, 900).choose_halvings(0, true) == 0);
}

TEST_CASE("one slow window is no reason for smaller images, unless images are dropped") {
  Machine machine(0.3);
  machine.encode_many(20);
  for (int i = 0; i < 10; ++i) {
    machine.least_seconds = 5;
    CHECK(machine.encode_many(2) == 0);
    machine.least_seconds = 0.3;
    CHECK(machine.encode_many(8) == 0);
  }
  // The work is then the least.
  machine.least_seconds = 5;
  while (machine.controller.iterations(kWindow, 0) > kMinSteps) machine.encode();
  machine.encode();
  CHECK(machine.encode(0, true) == 1);
  // Or were dropped while the first window was trained.
  Machine full(5);
  full.encode(0, true);
  while (full.controller.iterations(kWindow, 0) > kMinSteps) CHECK(full.encode() == 0);
  CHECK(full.encode_many(2) == 1);
}

TEST_CASE("preparing alone can make images smaller") {
  LiveController controller(30, 1.5, 900);
  controller.limit_halvings(kMaxHalvings);
  int windows = 0;
  while (controller.choose_halvings(0, false) == 0 && windows < 100) {
    controller.prepared(0, kWindow, controller.point_interval(kWindow, 0), 0.7);
    controller.trained(0, kWindow, controller.iterations(kWindow, 0), 0.2);
    ++windows;
  }
  CHECK(windows >= 3);
  CHECK(windows < 30);
}

TEST_CASE("images become larger after ten windows with much work") {
  Machine machine(2);
  REQUIRE(machine.encode_many(50) == 2);
  machine.least_seconds = 0.15;  // another program has ended
  CHECK(machine.encode_many(9) == 2);
  int windows = 9;
  for (; windows < 100 && machine.encode() == 2; ++windows) continue;
  CHECK(windows < 30);
  CHECK(machine.encode_many(9) == 1);
  CHECK(machine.encode_many(20) == 0);
  CHECK(machine.encode_many(200) == 0);
}

TEST_CASE("images do not become larger during a backlog") {
  Machine machine(1.2);
  REQUIRE(machine.encode_many(50) == 1);
  machine.least_seconds = 0.1;
  CHECK(machine.encode_many(50, 2 * kWindow) == 1);
  CHECK(machine.encode_many(50) == 0);
}

TEST_CASE("images that are soon too large again become larger less and less often") {
  // Most of the time does not depend on the steps: half the size has time for many, the full one
  // not even for the least.
  Machine machine(0.5);
  machine.cost = 2;
  machine.fixed_share = 0.9;
  std::vector<int> lengths{0};  // windows at half the size
  for (int i = 0; i < 800; ++i) {
    const int halvings = machine.encode();
    REQUIRE(halvings <= 1);
    if (halvings == 1) ++lengths.back();
    if (halvings == 0 && lengths.back() > 0) lengths.push_back(0);
  }
  REQUIRE(lengths.size() >= 6);
  for (std::size_t k = 1; k < 5; ++k) CHECK(lengths[k] > 1.5 * lengths[k - 1]);
  CHECK(lengths[5] < 200);
  // Another program has ended, and starts again much later.
  machine.least_seconds = 0.1;
  CHECK(machine.encode_many(500) == 0);
  machine.least_seconds = 0.5;
  while (machine.encode() == 0) continue;
  int again = 1;
  while (machine.encode() == 1) ++again;
  CHECK(again < lengths[1]);
}

TEST_CASE("windows of another size teach nothing") {
  LiveController controller(30, 1.5, 900);
  controller.limit_halvings(kMaxHalvings);
  const int steps = controller.iterations(kWindow, 0),
            interval = controller.point_interval(kWindow, 0);
  for (int i = 0; i < 10; ++i) {
    controller.trained(1, kWindow, kMinSteps, 100);
    controller.prepared(2, kWindow, kWindow, 100);
  }
  CHECK(controller.iterations(kWindow, 0) == steps);
  CHECK(controller.point_interval(kWindow, 0) == interval);
  CHECK(controller.choose_halvings(0, true) == 0);
}

TEST_CASE("the images and cameras of a window are halved together") {
  PreparedCapture rig;
  for (const char* name : {"left", "middle", "right"}) {
    Camera& camera = rig.cameras.emplace_back();
    camera.name = name;
    camera.width = 257;
    camera.height = 129;
    camera.fx = camera.fy = 200;
    camera.cx = 128.5;
    camera.cy = 64.5;
  }
  CHECK(max_halvings(rig.cameras) == 1);
  rig.cameras[2].height = 127;
  CHECK(max_halvings(rig.cameras) == 0);
  rig.cameras[2].height = 129;
  for (Camera& camera : rig.cameras) camera.height *= 4;
  CHECK(max_halvings(rig.cameras) == 2);
  for (Camera& camera : rig.cameras) camera.height /= 4;

  // Four columns of pixels have one brightness. Camera 1 of the preparer takes no part.
  Image8 image{257, 129, 3, {}};
  for (int i = 0; i < 257 * 129 * 3; ++i)
    image.data.push_back(static_cast<std::uint8_t>(i / 3 % 257 / 4 * 4));
  const auto shared = std::make_shared<const Image8>(image);
  LiveFrames frames;
  frames.first = 30;
  frames.frames.push_back({{shared, nullptr, shared, shared}, 0});
  frames.frames.push_back({{shared, nullptr, nullptr, shared}, 0});
  CHECK(count_missing(frames, {0, 2, 3}) == 1);
  const PreparedCapture full = live_capture(rig, {0, 2, 3}, frames, 0);
  CHECK(full.first_frame == 30);
  CHECK(full.frames == 2);
  CHECK(full.cameras[0].width == 257);
  CHECK(full.memory->frame("left", 0) == shared);
  CHECK(full.memory->frame("middle", 1) == nullptr);

  const PreparedCapture quarter = live_capture(rig, {0, 2, 3}, frames, 2);
  CHECK(quarter.cameras[1].width == 64);
  CHECK(quarter.cameras[1].height == 32);
  CHECK(quarter.cameras[1].fx == 50);
  CHECK(quarter.cameras[1].cx == 128.5 / 4);
  const auto small = quarter.memory->frame("right", 1);
  REQUIRE(small);
  CHECK(small->width == 64);
  CHECK(small->height == 32);
  for (int x = 0; x < 63; ++x) CHECK(small->data[3 * x] == 4 * x % 256);
}
