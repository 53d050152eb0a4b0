// SPDX-License-Identifier: Apache-2.0
// The arithmetic of following a recording: where its edge is, how far behind it, when to look.
#include "catch.h"
#include "stream/live_edge.h"
#include "stream/poll_interval.h"

namespace stgs::player {
namespace {

LiveSettings near_the_edge() {
  LiveSettings settings;
  settings.latency_seconds = 0;
  return settings;
}

TEST_CASE("the edge moves on with the clock, and no further than a stretch") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  edge.observe(10, 0.5, 100);
  edge.observe(10.5, 0.5, 100.3);  // when it came is known from here on
  CHECK(edge.edge(100.3) == Approx(10.5));
  CHECK(edge.edge(100.6) == Approx(10.8));
  CHECK(edge.edge(105) == Approx(11));
}

TEST_CASE("play is as far behind as a stretch is long and as they come unevenly") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  CHECK(edge.target_latency() == Approx(0.55));
  double now = 100, moment = 10;
  edge.observe(moment, 0.5, now);
  for (int k = 0; k < 8; ++k) edge.observe(moment += 0.5, 0.5, now += 0.5);
  CHECK(edge.target_latency() == Approx(0.55));
  edge.observe(moment += 0.5, 0.5, now += 0.7);  // .2 s late
  CHECK(edge.target_latency() == Approx(0.75));
  edge.observe(moment += 0.5, 0.5, now += 0.3);
  CHECK(edge.target_latency() == Approx(0.75));
  // Whoever is so far behind the earliest has not run out when the latest came.
  CHECK(edge.target(now - 0.3) <= moment - 0.5 + 1e-9);
  for (int k = 0; k < 16; ++k) edge.observe(moment += 0.5, 0.5, now += 0.5);
  CHECK(edge.target_latency() == Approx(0.55));
  LiveSettings further;
  further.latency_seconds = 2;
  CHECK(LiveEdge(further, 10, 0.5).target_latency() == Approx(2));
}

TEST_CASE("a recorder that stood still is followed as it is then") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  double now = 100, moment = 10;
  edge.observe(moment, 0.5, now);
  for (int k = 0; k < 8; ++k) edge.observe(moment += 0.5, 0.5, now += 0.5);
  edge.observe(moment += 0.5, 0.5, now += 30);
  CHECK(edge.target_latency() == Approx(0.55));
  CHECK(edge.edge(now) == Approx(moment));
  edge.observe(moment += 30, 0.5, now += 0.1);  // and one that has much to make up for
  CHECK(edge.edge(now) == Approx(moment));
}

TEST_CASE("an edge that was there before it was looked at tells nothing of delays") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  double now = 100, moment = 10;
  edge.observe(moment, 0.5, now);
  for (int k = 0; k < 4; ++k) edge.observe(moment += 0.5, 0.5, now += 0.5);
  edge.extend_to(moment += 0.5);
  edge.observe(moment, 0.5, now += 0.9);
  CHECK(edge.target_latency() == Approx(0.55));
  CHECK(edge.edge(now) == Approx(moment + 0.4));
}

TEST_CASE("the pace is bounded, and nothing near the target") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  edge.observe(10, 0.5, 100);
  const double target = edge.target(100);
  CHECK(edge.rate_factor(target, 100) == 1);
  CHECK(edge.rate_factor(target - 0.01, 100) == 1);
  CHECK(edge.rate_factor(target - 0.1, 100) == Approx(1.05));
  CHECK(edge.rate_factor(target - 2, 100) == Approx(1.1));
  CHECK(edge.rate_factor(target + 2, 100) == Approx(0.9));
  CHECK_FALSE(edge.should_skip(target - 2.9, 100));
  CHECK(edge.should_skip(target - 3.1, 100));
}

TEST_CASE("looks are frequent when a stretch is due, and rare when none comes") {
  PollInterval pace(0.05, 100);
  CHECK(pace.seconds() == 0);
  pace.update(false, 100);
  CHECK(pace.seconds() == Approx(0.05));
  double now = 100.2;
  pace.update(true, now);
  now += 0.5;
  pace.update(true, now);
  CHECK(pace.seconds() == Approx(0.25));  // half of what passed between the last two
  int looks = 0;
  for (; now < 110; now += pace.seconds(), ++looks) pace.update(false, now);
  CHECK(pace.seconds() == Approx(PollInterval::kMaxSeconds));
  CHECK(looks < 40);
  CHECK(pace.idle_seconds(now) > 9);
  pace.update(true, now);
  CHECK(pace.idle_seconds(now) == 0);
  pace.update(true, now + 0.5);
  pace.update(false, now + 0.75);
  CHECK(pace.seconds() == Approx(0.05));
}

TEST_CASE("looks that are to follow each other at once leave time for other work") {
  PollInterval pace(0, 100);
  pace.update(true, 100);
  CHECK(pace.seconds() == PollInterval::kMinSeconds);
  pace.update(false, 100);
  CHECK(pace.seconds() == PollInterval::kMinSeconds);
}

}  // namespace
}  // namespace stgs::player
