// SPDX-License-Identifier: Apache-2.0
// Playback of a stream: the order of reads, stalls, and failures.
#include <algorithm>
#include <chrono>
#include <limits>
#include <map>
#include <set>

#include "catch.h"
#include "stream/need.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

TEST_CASE(
    "a seek shows exactly the primitives of the file that are active, once they have arrived") {
  TestPlayer p;
  for (const std::uint32_t frame : {0u, 45u, 89u, 3u}) {
    REQUIRE(p.player->seek_frame(frame).ok());
    CHECK(p.player->advance(p.now) == frame / 30.0);
    REQUIRE(p.wait_complete());
    CHECK(p.player->ready());
    CHECK(active_fingerprints(p.player->timeline(), frame / 30.0) == active_in_file(frame / 30.0));
  }
  CHECK_FALSE(p.player->seek_frame(kFrames).ok());
  CHECK_FALSE(p.player->seek(std::numeric_limits<double>::quiet_NaN()).ok());
  CHECK_FALSE(p.player->set_rate(0).ok());
  CHECK_FALSE(p.player->set_rate(4.5).ok());
}

TEST_CASE("layers are fetched by deadline, beginning with the base at the position") {
  PlayerSettings settings;
  settings.max_reads_in_flight = 1;
  TestPlayer p(settings, clip().bytes,
               [](Link& link) { link.set(Link::Answer::kWait, clip().segments_begin); });
  // One read at the beginning of the clip is in flight during the seek.
  REQUIRE(p.wait_until([&] { return p.link->reads().back() >= clip().segments_begin; }));
  const std::size_t before = p.link->reads().size();
  REQUIRE(p.player->seek(2.0).ok());
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.wait_complete());
  const SceneReader& reader = *clip().reader;
  std::map<std::uint64_t, double> deadlines;
  const Playhead playhead{60, 30, kFrames, false};
  for (const SegmentInfo& s : reader.segments()) {
    const Need need = need_of(s.begin_ticks, s.end_ticks, playhead);
    deadlines[s.offset] = deadline(need, layer_of(s, false, 3), settings.layer_lead_seconds);
    if (s.sh_bytes > 0) {
      deadlines[s.sh_offset] = deadline(need, layer_of(s, true, 3), settings.layer_lead_seconds);
    }
  }
  const std::vector<std::uint64_t> reads = p.link->reads();
  REQUIRE(reads.size() > before + 8);
  double last = 0;
  for (std::size_t k = before; k < reads.size(); ++k) {
    CHECK(deadlines.at(reads[k]) >= last);
    last = deadlines.at(reads[k]);
  }
  CHECK(deadlines.at(reads[before]) == 0);
}

TEST_CASE("playback stalls without data, resumes with it, and reports both") {
  TestPlayer p({}, clip().bytes,
               [](Link& link) { link.set(Link::Answer::kWait, clip().segments_begin); });
  p.player->play();
  for (int k = 0; k < 5; ++k) p.player->advance(p.now += 1);
  CHECK(p.player->state() == PlayerState::kBuffering);
  CHECK(p.player->seconds() == 0);
  CHECK(active_fingerprints(p.player->timeline(), 0).empty());
  CHECK(p.player->buffered().empty());
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
  p.play_to_end();
  CHECK(p.player->seconds() == 89.0 / 30);
  CHECK(p.count(Kind::kBuffering) >= 1);
  CHECK(p.count(Kind::kResumed) == p.count(Kind::kBuffering));
  CHECK(p.count(Kind::kEnded) == 1);
  CHECK(p.count(Kind::kReadFailed) == 0);
  REQUIRE(p.player->buffered().size() == 1);
  CHECK(p.player->buffered()[0].end == Approx(3.0));
}

TEST_CASE("a seek during playback reports a stall once") {
  PlayerSettings settings;
  settings.prefetch_seconds = 0.1;
  settings.resume_seconds = 0.05;
  TestPlayer p(settings);
  REQUIRE(p.wait_complete());
  p.player->play();
  REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
  CHECK(p.count(Kind::kBuffering) == 0);  // all data was available
  CHECK(p.count(Kind::kResumed) == 0);
  p.link->set(Link::Answer::kWait, clip().segments_begin);
  REQUIRE(p.player->seek(2.5).ok());
  REQUIRE(p.wait_until([&] { return p.count(Kind::kBuffering) > 0; }));
  REQUIRE(p.player->seek(2.0).ok());
  for (int k = 0; k < 5; ++k) p.player->advance(p.now += 1);
  CHECK(p.player->seconds() == 2.0);
  p.player->pause();
  p.player->play();
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
  CHECK(p.count(Kind::kBuffering) == 1);
  CHECK(p.count(Kind::kResumed) == 1);
}

TEST_CASE("playback continues without data after failed reads, which are retried") {
  PlayerSettings settings;
  settings.retry_seconds = 0.02;
  TestPlayer p(settings, clip().bytes,
               [](Link& link) { link.set(Link::Answer::kFail, clip().segments_begin); });
  p.player->play();
  // No data can be read: playback continues with empty frames instead of stalling.
  REQUIRE(p.wait_until([&] { return p.count(Kind::kReadFailed) > 3; }));
  CHECK(p.has_event(Kind::kReadFailed, "the link is down"));
  CHECK_FALSE(p.player->ready());
  p.link->set(Link::Answer::kBytes);
  p.player->pause();
  REQUIRE(p.wait_complete());
  CHECK(active_fingerprints(p.player->timeline(), p.player->seconds()) ==
        active_in_file(p.player->seconds()));
}

TEST_CASE("damage affects its segment layer alone") {
  const SegmentInfo* base = nullptr;
  const SegmentInfo* sh = nullptr;
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.level < 0 && s.tier == 1) base = &s;
    if (s.level < 0 && s.tier == 0 && s.sh_bytes > 0) sh = &s;
  }
  REQUIRE(base != nullptr);
  REQUIRE(sh != nullptr);
  std::vector<std::uint8_t> bytes = clip().bytes;
  bytes[base->offset + base->bytes / 2] ^= 1;
  bytes[sh->sh_offset + sh->sh_bytes / 2] ^= 1;
  TestPlayer p({}, bytes);
  REQUIRE(p.wait_until([&] { return p.count(Kind::kDamaged) >= 2; }));
  REQUIRE(p.wait_until([&] { return p.player->ready(); }));
  std::set<std::uint64_t> damaged;
  for (const PlayerEvent& event : p.events) {
    if (event.kind == Kind::kDamaged) damaged.insert(event.offset);
  }
  CHECK(damaged.contains(base->offset));
  CHECK(damaged.contains(sh->sh_offset));
  const auto active = p.player->timeline().at(0);
  REQUIRE(active.ok());
  const auto segment = static_cast<std::uint32_t>(sh - clip().reader->segments().data());
  CHECK(std::any_of(active->segments.begin(), active->segments.end(),
                    [&](const auto& part) { return part.segment == segment; }));
}

TEST_CASE("a position is complete when nothing more will arrive, damaged or not") {
  TestPlayer intact;
  REQUIRE(intact.wait_until([&] { return intact.player->is_complete(); }));
  CHECK(intact.player->layers() == intact.player->layer_count());

  const SegmentInfo* base = nullptr;
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.level < 0 && s.tier == 1) base = &s;
  }
  REQUIRE(base != nullptr);
  std::vector<std::uint8_t> bytes = clip().bytes;
  bytes[base->offset + base->bytes / 2] ^= 1;
  TestPlayer damaged({}, bytes);
  REQUIRE(damaged.wait_until([&] { return damaged.player->is_complete(); }));
  CHECK(damaged.count(Kind::kDamaged) > 0);
  CHECK(damaged.player->layers() == 1);
  CHECK(damaged.player->ready());

  PlayerSettings settings;
  settings.retry_seconds = 60;
  const auto lost = [](Link& link) { link.set(Link::Answer::kFail, clip().segments_begin); };
  TestPlayer down(settings, clip().bytes, lost);
  REQUIRE(down.wait_until([&] { return down.player->is_complete(); }));
  CHECK(down.player->layers() == 0);
  CHECK_FALSE(down.player->ready());

  const auto waits = [](Link& link) { link.set(Link::Answer::kWait, clip().segments_begin); };
  TestPlayer waiting({}, clip().bytes, waits);
  waiting.wait_until([&] { return !waiting.link->reads().empty(); });
  CHECK_FALSE(waiting.player->is_complete());
}

TEST_CASE("playback runs backwards and loops") {
  TestPlayer p;
  REQUIRE(p.player->seek_frame(89).ok());
  REQUIRE(p.player->set_rate(-2).ok());
  p.player->play();
  double last = 1e9;
  p.play_to_end([&] {
    CHECK(p.player->seconds() <= last);
    last = p.player->seconds();
  });
  CHECK(p.player->seconds() == 0);
  p.player->set_loop(true);
  REQUIRE(p.player->set_rate(4).ok());
  p.player->play();
  REQUIRE(p.wait_until([&] {
    p.now += 1.0 / 30;
    return p.count(Kind::kLooped) >= 3;
  }));
}

TEST_CASE("all layers arrive whatever the lead between layers") {
  PlayerSettings settings;
  settings.layer_lead_seconds = 60;
  settings.prefetch_seconds = 0.5;
  TestPlayer p(settings);
  REQUIRE(p.wait_complete());
}

TEST_CASE("a paused player gets every layer over a slow link") {
  TestPlayer p({}, clip().bytes, [](Link& link) {
    link.limit(static_cast<double>(clip().bytes.size()),
               clip().segments_begin);  // all of it in one second
  });
  REQUIRE(p.player->seek_frame(89).ok());
  REQUIRE(p.wait_complete());
  REQUIRE(p.player->seek_frame(40).ok());
  REQUIRE(p.wait_complete());
}

TEST_CASE("a link that has become faster is used at once") {
  PlayerSettings settings;
  settings.retry_seconds = 0.01;
  settings.prefetch_seconds = 0.5;
  TestPlayer p(settings, clip().bytes,
               [](Link& link) { link.limit(20000, clip().segments_begin); });
  p.player->set_loop(true);
  p.player->play();
  REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
  p.link->limit(0, 0);
  REQUIRE(p.wait_until([&] {
    p.now += 0.01;
    return p.player->layers() == p.player->layer_count();
  }));
}

TEST_CASE("a seek does not wait for a read that stalls") {
  PlayerSettings settings;
  settings.max_reads_in_flight = 2;
  const SegmentInfo* late = nullptr;  // active at the end only
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.tier == 0 && s.level >= 0 && s.begin_ticks >= 60) late = &s;
  }
  REQUIRE(late != nullptr);
  settings.prefetch_seconds = 0.2;
  TestPlayer p(settings, clip().bytes, [&](Link& link) {
    link.set(Link::Answer::kWait, late->offset, late->offset + late->bytes);
  });
  REQUIRE(p.player->seek_frame(static_cast<std::uint32_t>(late->begin_ticks) + 2).ok());
  REQUIRE(p.wait_until([&] {
    const auto reads = p.link->reads();
    return std::find(reads.begin(), reads.end(), late->offset) != reads.end();
  }));
  REQUIRE(p.player->seek_frame(5).ok());
  p.player->play();
  REQUIRE(p.wait_until([&] { return p.player->state() == PlayerState::kPlaying; }));
}

TEST_CASE("a player is destroyed at once while its reads wait") {
  const auto begin = std::chrono::steady_clock::now();
  {
    TestPlayer p({}, clip().bytes,
                 [](Link& link) { link.set(Link::Answer::kWait, clip().segments_begin); });
    REQUIRE(p.wait_until([&] { return p.link->reads().back() >= clip().segments_begin; }));
  }
  CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(20));
}

}  // namespace
}  // namespace stgs::player
