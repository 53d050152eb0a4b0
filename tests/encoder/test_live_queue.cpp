// SPDX-License-Identifier: Apache-2.0
// The frames of live cameras in order.
#include "stream/live_queue.h"

#include <cmath>

#include "catch.h"

using namespace stgs;
using namespace stgs::encoder;

namespace {

constexpr double kFps = 10;
constexpr std::size_t kBytes = 300;

std::shared_ptr<const Image8> image(int value = 0) {
  Image8 out{10, 10, 3, {}};
  out.data.assign(kBytes, static_cast<std::uint8_t>(value));
  return std::make_shared<const Image8>(std::move(out));
}

// A clock that the test sets. Waiting advances it, so that no call waits for long.
struct Clock {
  double seconds = 0;
  std::function<double()> now() {
    return [this] { return seconds += 1e-3; };
  }
};

// Frames [begin, end) of a camera, each delivered when it is filmed.
void film(LiveQueue& queue, std::size_t camera, int begin, int end, double offset = 0) {
  for (int f = begin; f < end; ++f) queue.push(camera, f / kFps + offset, image(f), f / kFps);
}

}  // namespace

TEST_CASE("a live capture begins with the first frame that all cameras delivered") {
  LiveQueue queue(3, kFps, 1 << 20);
  Clock clock;
  film(queue, 0, 5, 12);
  film(queue, 1, 7, 12, 0.02);  // its clock is 0.2 frames ahead
  film(queue, 2, 6, 11);
  CHECK(queue.start(100, clock.now()) == std::vector<bool>{true, true, true});
  clock.seconds = 1.1;
  const LiveFrames frames = queue.take(3, 3, clock.now());
  CHECK(frames.first == 0);
  REQUIRE(frames.frames.size() == 3);
  CHECK(frames.frames[0].images[0]->data[0] == 7);
  CHECK(frames.frames[0].images[1]->data[0] == 7);
  CHECK(frames.frames[0].images[2]->data[0] == 7);
  CHECK(frames.frames[2].arrived == 0.9);
  CHECK(frames.waiting == 1);  // frame 10; camera 2 has not delivered frame 11
  CHECK(queue.take(1, 5, clock.now()).first == 3);
  CHECK(queue.dropped().total() == 0);
}

TEST_CASE("cameras may start late, stall, repeat frames and drop out") {
  LiveQueue queue(3, kFps, 1 << 20);
  Clock clock;
  film(queue, 0, 0, 3);
  film(queue, 1, 0, 3);
  // Camera 2 delivers nothing: the latest frame of the others begins the capture.
  CHECK(queue.start(0.5, clock.now()) == std::vector<bool>{true, true, false});
  CHECK(clock.seconds >= 0.5);
  film(queue, 2, 0, 3);
  film(queue, 0, 3, 10);
  queue.push(0, 0.9, image(99), 0.9);
  CHECK(queue.dropped().repeated == 1);
  // Camera 1 stalls: its frames are missing after the grace time.
  clock.seconds = 0.3;
  CHECK(queue.take(1, 1, clock.now()).frames[0].images[1]->data[0] == 2);
  CHECK(queue.ready(0.3) == 0);
  CHECK(queue.ready(0.9) == 7);
  const LiveFrames without = queue.take(4, 4, clock.now());
  REQUIRE(without.frames.size() == 4);
  CHECK(without.frames[0].images[1] == nullptr);
  CHECK(without.frames[0].images[0]->data[0] == 3);
  // It comes back, with frames that were taken, and others.
  film(queue, 1, 5, 10);
  CHECK(queue.dropped().late == 2);
  queue.end(0);
  queue.end(1);
  const LiveFrames last = queue.take(100, 100, clock.now());
  REQUIRE(last.frames.size() == 3);
  CHECK(last.frames[0].images[1]->data[0] == 7);
  CHECK(queue.take(1, 1, clock.now()).frames.empty());
}

TEST_CASE("jumps of a clock and full memory drop images, and are counted") {
  LiveQueue queue(2, kFps, 12 * kBytes);
  Clock clock;
  film(queue, 0, 0, 3);
  film(queue, 1, 0, 3);
  CHECK(queue.start(1, clock.now()).size() == 2);
  queue.push(1, 600, image(), 0.3);
  queue.push(1, -600, image(), 0.3);
  CHECK(queue.dropped().ahead == 1);
  CHECK(queue.dropped().late == 1);
  film(queue, 0, 3, 8);
  film(queue, 1, 3, 8);
  CHECK(queue.dropped().overflow == 4);
  clock.seconds = 0.8;
  // The frames after dropped ones keep their times.
  CHECK(queue.take(6, 6, clock.now()).frames.size() == 6);
  film(queue, 0, 10, 12);
  film(queue, 1, 10, 12);
  clock.seconds = 1.2;
  const LiveFrames frames = queue.take(6, 6, clock.now());
  CHECK(frames.first == 6);
  REQUIRE(frames.frames.size() == 6);
  CHECK(frames.frames[0].images[1] == nullptr);
  CHECK(frames.frames[2].images[0] == nullptr);
  CHECK(frames.frames[4].images[0]->data[0] == 10);
}

TEST_CASE("a camera with a wrong clock stops neither the others nor itself") {
  LiveQueue queue(2, kFps, 1 << 20);
  Clock clock;
  film(queue, 0, 0, 3);
  film(queue, 1, 0, 3);
  CHECK(queue.start(1, clock.now()).size() == 2);
  film(queue, 0, 3, 20);
  film(queue, 1, 3, 20, 1e6);
  for (const double seconds : {std::nan(""), HUGE_VAL, -HUGE_VAL, -1e300})
    queue.push(1, seconds, image(), 1.9);
  clock.seconds = 1.9;
  const LiveFrames frames = queue.take(20, 20, clock.now());
  REQUIRE(frames.frames.size() == 20);
  CHECK(frames.frames[19].images[1] == nullptr);
  CHECK(queue.dropped().ahead + queue.dropped().late == 21);
  film(queue, 0, 20, 25);
  film(queue, 1, 20, 25);
  clock.seconds = 2.4;
  CHECK(queue.take(5, 5, clock.now()).frames[4].images[1]->data[0] == 24);
}

TEST_CASE("a rig that pauses continues, after the time that has passed") {
  LiveQueue queue(2, kFps, 1 << 20);
  Clock clock;
  for (const std::size_t c : {0, 1}) film(queue, c, 0, 3);
  CHECK(queue.start(1, clock.now()).size() == 2);
  for (const std::size_t c : {0, 1}) film(queue, c, 300, 303);  // half a minute later
  clock.seconds = 30.3;
  LiveFrames frames = queue.take(303, 1000, clock.now());
  REQUIRE(frames.frames.size() == 303);
  CHECK(frames.frames[299].images[0] == nullptr);
  CHECK(frames.frames[302].images[1] != nullptr);
  for (const std::size_t c : {0, 1}) film(queue, c, 100000, 100003);  // hours later
  clock.seconds = 10000.3;
  frames = queue.take(1, 1 << 20, clock.now());
  CHECK(static_cast<double>(frames.frames.size()) == kFps * LiveQueue::kMaxPauseSeconds + 3);
  CHECK(queue.dropped().total() == 0);
}

TEST_CASE("a window that the memory cannot hold is shorter") {
  LiveQueue queue(2, kFps, 6 * kBytes);
  Clock clock;
  // Until the start, the memory holds the latest images.
  film(queue, 0, 0, 20);
  CHECK(queue.dropped().overflow == 0);
  film(queue, 1, 19, 20);
  CHECK(queue.start(5, clock.now()).size() == 2);
  for (int f = 20; f < 24; ++f)
    for (const std::size_t c : {0, 1}) film(queue, c, f, f + 1);
  clock.seconds = 2.4;
  CHECK(queue.dropped().overflow > 0);
  CHECK(queue.take(8, 8, clock.now()).frames.size() >= 2);
}

TEST_CASE("without cameras that film, a live capture does not start") {
  LiveQueue queue(2, kFps, 1 << 20);
  Clock clock;
  film(queue, 0, 0, 3);
  queue.end_all();
  CHECK(queue.start(1, clock.now()).empty());
}
