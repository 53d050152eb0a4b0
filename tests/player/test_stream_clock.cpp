// SPDX-License-Identifier: Apache-2.0
// Times of playback: positions, deadlines and throughput.
#include <limits>
#include <utility>

#include "catch.h"
#include "stgs/format/scene_file.h"
#include "stream/need.h"
#include "stream/playback_clock.h"
#include "stream/throughput.h"

namespace stgs::player {
namespace {

TEST_CASE("the time until a segment is needed depends on the position and direction of playback") {
  const auto need = [](double begin, double end, const Playhead& playhead) {
    const Need n = need_of(begin, end, playhead);
    return std::pair(n.from, n.until);
  };
  constexpr double kNever = std::numeric_limits<double>::infinity();
  CHECK(need(40, 60, {20, 10, 100, false}) == std::pair(2.0, 4.0));
  CHECK(need(10, 60, {20, 10, 100, false}) == std::pair(0.0, 4.0));
  CHECK(need(10, 15, {20, 10, 100, false}) == std::pair(kNever, kNever));
  CHECK(need(10, 15, {20, 10, 100, true}) == std::pair(9.0, 9.5));
  CHECK(need(10, 60, {20, 10, 100, false, true}) == std::pair(0.0, kNever));
  CHECK(need(10, 15, {20, -10, 100, false}) == std::pair(0.5, 1.0));
  CHECK(need(40, 60, {20, -10, 100, false}) == std::pair(kNever, kNever));
  CHECK(need(40, 60, {20, -20, 100, true}) == std::pair(3.0, 4.0));
}

TEST_CASE("a position follows the clock at its rate, and ends or loops") {
  PlaybackClock clock(89, 30);
  clock.apply(clock.after(1));
  CHECK(clock.ticks() == 30);
  clock.set_rate(4);
  const PlaybackClock::Step end = clock.after(1);
  CHECK(end.ended);
  CHECK(end.ticks == 89);
  clock.set_loop(true);
  CHECK(clock.after(1).looped);
  CHECK(clock.after(1).ticks == Approx(60));
  clock.set_loop(false);
  clock.set_rate(-2);
  CHECK(clock.after(0.25).ticks == 15);
  CHECK(clock.after(1).ended);
  CHECK(clock.after(1).ticks == 0);
  clock.seek(1e9);
  CHECK(clock.ticks() == 89);
}

TEST_CASE("the throughput of a link counts only time with transfers in flight") {
  Throughput link;
  CHECK(link.bytes_per_second() == 0);
  link.begin(10);
  link.begin(10);
  link.add_bytes(1000, 10.5);
  link.end(10.5);
  link.add_bytes(1000, 11);
  link.end(11);
  const double before = link.bytes_per_second();
  CHECK(before == Approx(2000).epsilon(0.2));
  link.begin(500);
  CHECK(link.bytes_per_second() == before);
  for (double t = 500.5; t < 530; t += 0.5) link.add_bytes(50, t);
  CHECK(link.bytes_per_second() == Approx(100).epsilon(0.2));
}

TEST_CASE("the time of each frame converts back to the frame in every time base") {
  for (const TimeBase base : {TimeBase{1, 30}, {1001, 24000}, {1001, 30000}, {1, 25}, {1, 1000}}) {
    for (std::uint32_t frame = 0; frame < 100000; frame += 7) {
      REQUIRE(base.ticks(base.seconds(frame)) == frame);
    }
    CHECK(base.ticks(base.seconds(1234.5)) == Approx(1234.5).epsilon(1e-15));
  }
}

}  // namespace
}  // namespace stgs::player
