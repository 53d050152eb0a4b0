// SPDX-License-Identifier: Apache-2.0
// The arithmetic of following a recording: where its edge is, how far behind it, when to look.
#include <catch2/catch.hpp>

#include "stream/live_edge.h"
#include "stream/poll_pace.h"

namespace stgs::player {
namespace {

LiveSettings near_the_edge() {
  LiveSettings settings;
  settings.behind_seconds = 0;
  return settings;
}

TEST_CASE("the edge moves on with the clock, and no further than a stretch") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  edge.saw(10, 0.5, 100);
  edge.saw(10.5, 0.5, 100.3);  // when it came is known from here on
  CHECK(edge.edge(100.3) == Approx(10.5));
  CHECK(edge.edge(100.6) == Approx(10.8));
  CHECK(edge.edge(105) == Approx(11));
}

TEST_CASE("play is as far behind as a stretch is long and as they come unevenly") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  CHECK(edge.wanted() == Approx(0.55));
  double now = 100, moment = 10;
  edge.saw(moment, 0.5, now);
  for (int k = 0; k < 8; ++k) edge.saw(moment += 0.5, 0.5, now += 0.5);
  CHECK(edge.wanted() == Approx(0.55));
  edge.saw(moment += 0.5, 0.5, now += 0.7);  // .2 s late
  CHECK(edge.wanted() == Approx(0.75));
  edge.saw(moment += 0.5, 0.5, now += 0.3);
  CHECK(edge.wanted() == Approx(0.75));
  // Whoever is so far behind the earliest has not run out when the latest came.
  CHECK(edge.target(now - 0.3) <= moment - 0.5 + 1e-9);
  for (int k = 0; k < 16; ++k) edge.saw(moment += 0.5, 0.5, now += 0.5);
  CHECK(edge.wanted() == Approx(0.55));
  LiveSettings further;
  further.behind_seconds = 2;
  CHECK(LiveEdge(further, 10, 0.5).wanted() == Approx(2));
}

TEST_CASE("a recorder that stood still is followed as it is then") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  double now = 100, moment = 10;
  edge.saw(moment, 0.5, now);
  for (int k = 0; k < 8; ++k) edge.saw(moment += 0.5, 0.5, now += 0.5);
  edge.saw(moment += 0.5, 0.5, now += 30);
  CHECK(edge.wanted() == Approx(0.55));
  CHECK(edge.edge(now) == Approx(moment));
  edge.saw(moment += 30, 0.5, now += 0.1);  // and one that has much to make up for
  CHECK(edge.edge(now) == Approx(moment));
}

TEST_CASE("an edge that was there before it was looked at tells nothing of delays") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  double now = 100, moment = 10;
  edge.saw(moment, 0.5, now);
  for (int k = 0; k < 4; ++k) edge.saw(moment += 0.5, 0.5, now += 0.5);
  edge.found(moment += 0.5);
  edge.saw(moment, 0.5, now += 0.9);
  CHECK(edge.wanted() == Approx(0.55));
  CHECK(edge.edge(now) == Approx(moment + 0.4));
}

TEST_CASE("the pace is bounded, and nothing near the target") {
  LiveEdge edge(near_the_edge(), 10, 0.5);
  edge.saw(10, 0.5, 100);
  const double target = edge.target(100);
  CHECK(edge.pace(target, 100) == 1);
  CHECK(edge.pace(target - 0.01, 100) == 1);
  CHECK(edge.pace(target - 0.1, 100) == Approx(1.05));
  CHECK(edge.pace(target - 2, 100) == Approx(1.1));
  CHECK(edge.pace(target + 2, 100) == Approx(0.9));
  CHECK_FALSE(edge.is_lost(target - 2.9, 100));
  CHECK(edge.is_lost(target - 3.1, 100));
}

TEST_CASE("looks are frequent when a stretch is due, and rare when none comes") {
  PollPace pace(0.05, 100);
  CHECK(pace.wait() == 0);
  pace.found(false, 100);
  CHECK(pace.wait() == Approx(0.05));
  double now = 100.2;
  pace.found(true, now);
  now += 0.5;
  pace.found(true, now);
  CHECK(pace.wait() == Approx(0.25));  // half of what passed between the last two
  int looks = 0;
  for (; now < 110; now += pace.wait(), ++looks) pace.found(false, now);
  CHECK(pace.wait() == Approx(PollPace::kLongest));
  CHECK(looks < 40);
  CHECK(pace.idle_for(now) > 9);
  pace.found(true, now);
  CHECK(pace.idle_for(now) == 0);
  pace.found(true, now + 0.5);
  pace.found(false, now + 0.75);
  CHECK(pace.wait() == Approx(0.05));
}

TEST_CASE("looks that are to follow each other at once leave time for other work") {
  PollPace pace(0, 100);
  pace.found(true, 100);
  CHECK(pace.wait() == PollPace::kShortest);
  pace.found(false, 100);
  CHECK(pace.wait() == PollPace::kShortest);
}

}  // namespace
}  // namespace stgs::player
