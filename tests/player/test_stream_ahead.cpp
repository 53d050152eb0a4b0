// SPDX-License-Identifier: Apache-2.0
// Segments that a player's timeline reports for prefetching.
#include <algorithm>
#include <cmath>
#include <vector>

#include "catch.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

TEST_CASE("segments of the next half second are reported, soonest first, in both directions") {
  for (const double rate : {1.0, 2.0, -1.0}) {
    CAPTURE(rate);
    TestPlayer p;
    Timeline& timeline = p.player->timeline();
    const double at = 1.51, ticks = timeline.metadata().time_base.ticks(at);
    REQUIRE(p.player->set_rate(rate).ok());
    REQUIRE(p.player->seek(at).ok());
    CHECK(timeline.prefetch_segments(at).empty());
    CHECK_FALSE(timeline.is_playing());
    p.player->play();
    REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
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
    REQUIRE(p.wait_until([&] {
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

TEST_CASE("playback that loops prefetches the other end of the clip") {
  for (const double rate : {1.0, -1.0}) {
    CAPTURE(rate);
    TestPlayer p;
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
    REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
    CHECK_FALSE(comes_soon());
    p.player->set_loop(true);
    CHECK(p.wait_until(comes_soon));
  }
}

}  // namespace
}  // namespace stgs::player
