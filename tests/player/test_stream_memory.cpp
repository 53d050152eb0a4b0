// SPDX-License-Identifier: Apache-2.0
// Playback within a memory budget.
#include <algorithm>

#include "catch.h"
#include "resident_segment.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

TEST_CASE("a position is complete when the remaining layers do not fit the budget") {
  std::uint64_t all = 0;
  for (const std::uint32_t s : clip().reader->segments_between(0, 0)) {
    const SegmentInfo& segment = clip().reader->segments()[s];
    all += segment.bytes + segment.sh_bytes + decoded_segment_bytes(segment.primitives, 2);
  }
  for (const double share : {0.001, 0.3, 0.6, 0.8}) {
    INFO(share);
    PlayerSettings settings;
    settings.retry_seconds = 60;
    settings.memory_budget = static_cast<std::uint64_t>(share * static_cast<double>(all));
    TestPlayer p(settings);
    REQUIRE(p.wait_until([&] { return p.player->is_complete(); }));
    CHECK(p.player->layers() < p.player->layer_count());
    // Another position may fit: it is judged separately.
    REQUIRE(p.player->seek_frame(45).ok());
    REQUIRE(p.wait_until([&] { return p.player->is_complete(); }));
  }
}

TEST_CASE("playback reaches the end within the memory budget") {
  PlayerSettings settings;
  std::uint64_t peak = 0;
  for (double t = 0; t < kFrames; t += 1) {
    std::uint64_t alive = 0;
    for (const std::uint32_t s : clip().reader->segments_between(t, t)) {
      const SegmentInfo& segment = clip().reader->segments()[s];
      alive += segment.bytes + segment.sh_bytes + 260 * std::uint64_t{segment.primitives};
    }
    peak = std::max(peak, alive);
  }
  settings.memory_budget = peak + peak / 4;
  TestPlayer p(settings);
  p.player->play();
  p.play_to_end([&] { CHECK(p.player->statistics().memory_bytes <= settings.memory_budget); });
  REQUIRE(p.wait_complete());

  settings.memory_budget = 1000;
  TestPlayer none(settings);
  REQUIRE(none.wait_until([&] { return none.count(Kind::kReadFailed) > 0; }));
  CHECK(none.has_event(Kind::kReadFailed, "memory"));
}

TEST_CASE("playback reaches the end with any budget, and reports one that is too small") {
  std::uint64_t peak = 0;
  for (double t = 0; t < kFrames; t += 1) {
    std::uint64_t base = 0;
    for (const std::uint32_t s : clip().reader->segments_between(t, t)) {
      const SegmentInfo& segment = clip().reader->segments()[s];
      if (segment.tier == 0) base += segment.bytes + decoded_segment_bytes(segment.primitives, 2);
    }
    peak = std::max(peak, base);
  }
  for (const double share : {0.3, 0.7, 1.02, 1.1, 1.5}) {
    INFO(share);
    PlayerSettings settings;
    settings.retry_seconds = 0.01;
    settings.memory_budget = static_cast<std::uint64_t>(share * static_cast<double>(peak));
    TestPlayer p(settings);
    p.player->play();
    p.play_to_end([&] { CHECK(p.player->statistics().memory_bytes <= settings.memory_budget); });
    if (share < 1) CHECK(p.has_event(Kind::kReadFailed, "memory"));
  }
}

TEST_CASE("playback that loops stalls at the end once, for the beginning") {
  PlayerSettings settings;
  settings.prefetch_seconds = 0.3;
  settings.memory_budget = 600'000;
  TestPlayer p(settings);
  REQUIRE(p.player->seek_frame(80).ok());
  REQUIRE(p.wait_complete());
  p.player->set_loop(true);
  p.link->set(Link::Answer::kWait, clip().segments_begin);
  p.player->play();
  for (int k = 0; k < 200; ++k) {
    p.wait_until([] { return true; });
    p.now += 0.02;
  }
  CHECK(p.count(Kind::kBuffering) <= 2);
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.wait_until([&] {
    p.now += 0.02;
    return p.count(Kind::kLooped) > 0;
  }));
}

}  // namespace
}  // namespace stgs::player
