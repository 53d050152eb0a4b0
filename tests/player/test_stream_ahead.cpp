// SPDX-License-Identifier: Apache-2.0
// What a player's timeline says comes next.
#include <algorithm>
#include <cmath>
#include <vector>

#include "catch.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

TEST_CASE(
    "what follows within half a second is known, the soonest first, whichever way play goes") {
  for (const double rate : {1.0, 2.0, -1.0}) {
    CAPTURE(rate);
    Playing p;
    Timeline& timeline = p.player->timeline();
    const double at = 1.51, ticks = timeline.metadata().time_base.ticks(at);
    REQUIRE(p.player->set_rate(rate).ok());
    REQUIRE(p.player->seek(at).ok());
    CHECK(timeline.prefetch_segments(at).empty());
    CHECK_FALSE(timeline.is_playing());
    p.player->play();
    REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
    CHECK(timeline.is_playing());

    const auto in = [&](const SegmentInfo& info) {  // seconds
      const double far = rate > 0 ? info.begin_ticks - ticks : ticks - info.end_ticks;
      return timeline.metadata().time_base.seconds(far) / std::abs(rate);
    };
    const std::vector<SegmentInfo>& segments = timeline.reader().segments();
    const auto expected = std::count_if(segments.begin(), segments.end(), [&](const auto& info) {
      return in(info) > 0 && in(info) <= 0.5;
    });
    REQUIRE(expected > 2);
    std::vector<Timeline::SegmentRef> soon;
    REQUIRE(p.until([&] {
      soon = timeline.prefetch_segments(at);
      return soon.size() == static_cast<std::size_t>(expected);
    }));
    double last = 0;
    for (const Timeline::SegmentRef& one : soon) {
      CHECK(one.set != nullptr);
      CHECK(in(segments[one.segment]) >= last);
      last = in(segments[one.segment]);
    }
    CHECK(last <= 0.5);
    p.player->pause();
    CHECK(timeline.prefetch_segments(at).empty());
  }
}

TEST_CASE("where play goes round, the other end of the clip comes soon") {
  for (const double rate : {1.0, -1.0}) {
    CAPTURE(rate);
    Playing p;
    Timeline& timeline = p.player->timeline();
    const double at = rate > 0 ? 2.9 : 0.05;
    REQUIRE(p.player->set_rate(rate).ok());
    REQUIRE(p.player->seek(at).ok());
    const std::vector<SegmentInfo>& segments = timeline.reader().segments();
    const auto other_end = [&](const Timeline::SegmentRef& one) {
      const SegmentInfo& info = segments[one.segment];
      return info.level == 0 && (rate > 0 ? info.begin_ticks == 0 : info.end_ticks == kFrames);
    };
    const auto comes_soon = [&] {
      const std::vector<Timeline::SegmentRef> soon = timeline.prefetch_segments(at);
      return std::any_of(soon.begin(), soon.end(), other_end);
    };
    p.player->play();
    REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
    CHECK_FALSE(comes_soon());
    p.player->set_loop(true);
    CHECK(p.until(comes_soon));
  }
}

}  // namespace
}  // namespace stgs::player
