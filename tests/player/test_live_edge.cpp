// SPDX-License-Identifier: Apache-2.0
// Estimates for following a recording: the live edge, the target latency, and the poll interval.
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

TEST_CASE("the edge advances with the clock by at most one fragment") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  edge.observe(10, 0.5, 100);
  edge.observe(10.5, 0.5, 100.3);  // its time of arrival is known
  CHECK(edge.edge(100.3) == Approx(10.5));
  CHECK(edge.edge(100.6) == Approx(10.8));
  CHECK(edge.edge(105) == Approx(11));
}

TEST_CASE("the target latency is the duration of a fragment plus the jitter") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  CHECK(edge.target_latency() == Approx(0.55));
  double now = 100, time = 10;
  edge.observe(time, 0.5, now);
  for (int k = 0; k < 8; ++k) edge.observe(time += 0.5, 0.5, now += 0.5);
  CHECK(edge.target_latency() == Approx(0.55));
  edge.observe(time += 0.5, 0.5, now += 0.7);  // 0.2 s late
  CHECK(edge.target_latency() == Approx(0.75));
  edge.observe(time += 0.5, 0.5, now += 0.3);
  CHECK(edge.target_latency() == Approx(0.75));
  // At this latency, playback had data until the latest arrival.
  CHECK(edge.target(now - 0.3) <= time - 0.5 + 1e-9);
  for (int k = 0; k < 16; ++k) edge.observe(time += 0.5, 0.5, now += 0.5);
  CHECK(edge.target_latency() == Approx(0.55));
  LiveSettings distant;
  distant.latency_seconds = 2;
  LiveEdge changed(distant, 10, 0.5);
  CHECK(changed.target_latency() == Approx(2));
  changed.set_latency(0);
  CHECK(changed.target_latency() == Approx(0.55));
}

TEST_CASE("a recorder that paused or catches up restarts the estimate") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  double now = 100, time = 10;
  edge.observe(time, 0.5, now);
  for (int k = 0; k < 8; ++k) edge.observe(time += 0.5, 0.5, now += 0.5);
  edge.observe(time += 0.5, 0.5, now += 30);
  CHECK(edge.target_latency() == Approx(0.55));
  CHECK(edge.edge(now) == Approx(time));
  edge.observe(time += 30, 0.5, now += 0.1);  // and one that catches up
  CHECK(edge.edge(now) == Approx(time));
}

TEST_CASE("an edge of unknown arrival does not affect the jitter") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  double now = 100, time = 10;
  edge.observe(time, 0.5, now);
  for (int k = 0; k < 4; ++k) edge.observe(time += 0.5, 0.5, now += 0.5);
  edge.extend_to(time += 0.5);
  edge.observe(time, 0.5, now += 0.9);
  CHECK(edge.target_latency() == Approx(0.55));
  CHECK(edge.edge(now) == Approx(time + 0.4));
}

TEST_CASE("the rate changes by at most 10 %, and not near the target") {
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

TEST_CASE("polls are frequent when a fragment is due, and rare when none arrives") {
  PollInterval interval(0.05, 100);
  CHECK(interval.seconds() == 0);
  interval.update(false, 100);
  CHECK(interval.seconds() == Approx(0.05));
  double now = 100.2;
  interval.update(true, now);
  now += 0.5;
  interval.update(true, now);
  CHECK(interval.seconds() == Approx(0.25));  // half of the last interval
  int polls = 0;
  for (; now < 110; now += interval.seconds(), ++polls) interval.update(false, now);
  CHECK(interval.seconds() == Approx(PollInterval::kMaxSeconds));
  CHECK(polls < 40);
  CHECK(interval.idle_seconds(now) > 9);
  interval.update(true, now);
  CHECK(interval.idle_seconds(now) == 0);
  interval.update(true, now + 0.5);
  interval.update(false, now + 0.75);
  CHECK(interval.seconds() == Approx(0.05));
}

TEST_CASE("polls without an interval still leave time for other work") {
  PollInterval interval(0, 100);
  interval.update(true, 100);
  CHECK(interval.seconds() == PollInterval::kMinSeconds);
  interval.update(false, 100);
  CHECK(interval.seconds() == PollInterval::kMinSeconds);
}

}  // namespace
}  // namespace stgs::player
