// SPDX-License-Identifier: Apache-2.0
// Playing what is still coming: what is fetched when, and what is shown of it.
#include <atomic>
#include <chrono>
#include <limits>
#include <map>
#include <set>
#include <thread>

#include "catch.h"
#include "resident_segment.h"
#include "stream/need.h"
#include "stream/playback_clock.h"
#include "stream/throughput.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

TEST_CASE("how long until a segment is needed depends on where and which way the viewer goes") {
  const auto need = [](double begin, double end, const Playhead& motion) {
    const Need n = need_of(begin, end, motion);
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

TEST_CASE("a moment follows the clock at its rate, and ends or goes round") {
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

TEST_CASE("the speed of a link counts only time in which something was under way") {
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

TEST_CASE("a sought frame has, once it has come, exactly what is alive in the file") {
  Playing p;
  for (const std::uint32_t frame : {0u, 45u, 89u, 3u}) {
    REQUIRE(p.player->seek_frame(frame).ok());
    CHECK(p.player->advance(p.now) == frame / 30.0);
    REQUIRE(p.complete());
    CHECK(p.player->ready());
    CHECK(active_fingerprints(p.player->timeline(), frame / 30.0) == alive_in_file(frame / 30.0));
  }
  CHECK_FALSE(p.player->seek_frame(kFrames).ok());
  CHECK_FALSE(p.player->seek(std::numeric_limits<double>::quiet_NaN()).ok());
  CHECK_FALSE(p.player->set_rate(0).ok());
  CHECK_FALSE(p.player->set_rate(4.5).ok());
}

TEST_CASE("what is needed first is fetched first, the base of the moment before all else") {
  PlayerSettings settings;
  settings.max_reads_in_flight = 1;
  Playing p(settings, clip().bytes,
            [](Link& link) { link.set(Link::Answer::kWait, clip().pieces_at); });
  // One read is under way, of the beginning; the moment is elsewhere before it is answered.
  REQUIRE(p.until([&] { return p.link->asked().back() >= clip().pieces_at; }));
  const std::size_t before = p.link->asked().size();
  REQUIRE(p.player->seek(2.0).ok());
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.complete());
  const SceneReader& reader = *clip().reader;
  std::map<std::uint64_t, double> urgencies;
  const Playhead motion{60, 30, kFrames, false};
  for (const SegmentInfo& s : reader.segments()) {
    const Need need = need_of(s.begin_ticks, s.end_ticks, motion);
    urgencies[s.offset] = deadline(need, layer_of(s, false, 3), settings.layer_lead_seconds);
    if (s.sh_bytes > 0) {
      urgencies[s.sh_offset] = deadline(need, layer_of(s, true, 3), settings.layer_lead_seconds);
    }
  }
  const std::vector<std::uint64_t> asked = p.link->asked();
  REQUIRE(asked.size() > before + 8);
  double last = 0;
  for (std::size_t k = before; k < asked.size(); ++k) {
    CHECK(urgencies.at(asked[k]) >= last);
    last = urgencies.at(asked[k]);
  }
  CHECK(urgencies.at(asked[before]) == 0);
}

TEST_CASE("play waits for what has not come, goes on when it has, and says so") {
  Playing p({}, clip().bytes, [](Link& link) { link.set(Link::Answer::kWait, clip().pieces_at); });
  p.player->play();
  for (int k = 0; k < 5; ++k) p.player->advance(p.now += 1);
  CHECK(p.player->state() == PlayerState::kBuffering);
  CHECK(p.player->seconds() == 0);
  CHECK(active_fingerprints(p.player->timeline(), 0).empty());
  CHECK(p.player->buffered().empty());
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
  p.to_the_end();
  CHECK(p.player->seconds() == 89.0 / 30);
  CHECK(p.count(Kind::kBuffering) >= 1);
  CHECK(p.count(Kind::kResumed) == p.count(Kind::kBuffering));
  CHECK(p.count(Kind::kEnded) == 1);
  CHECK(p.count(Kind::kReadFailed) == 0);
  REQUIRE(p.player->buffered().size() == 1);
  CHECK(p.player->buffered()[0].end == Approx(3.0));
}

TEST_CASE("a seek while playing tells of standing still where it does, once") {
  PlayerSettings settings;
  settings.prefetch_seconds = 0.1;
  settings.resume_seconds = 0.05;
  Playing p(settings);
  REQUIRE(p.complete());
  p.player->play();
  REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
  CHECK(p.count(Kind::kBuffering) == 0);  // all of it was there
  CHECK(p.count(Kind::kResumed) == 0);
  p.link->set(Link::Answer::kWait, clip().pieces_at);
  REQUIRE(p.player->seek(2.5).ok());
  REQUIRE(p.until([&] { return p.count(Kind::kBuffering) > 0; }));
  REQUIRE(p.player->seek(2.0).ok());
  for (int k = 0; k < 5; ++k) p.player->advance(p.now += 1);
  CHECK(p.player->seconds() == 2.0);
  p.player->pause();
  p.player->play();
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
  CHECK(p.count(Kind::kBuffering) == 1);
  CHECK(p.count(Kind::kResumed) == 1);
}

TEST_CASE("a link that goes down degrades the picture and is made up for") {
  PlayerSettings settings;
  settings.retry_seconds = 0.02;
  Playing p(settings, clip().bytes,
            [](Link& link) { link.set(Link::Answer::kFail, clip().pieces_at); });
  p.player->play();
  // Nothing can be had, so the empty picture goes on rather than standing still for ever.
  REQUIRE(p.until([&] { return p.count(Kind::kReadFailed) > 3; }));
  CHECK(p.said(Kind::kReadFailed, "the link is down"));
  CHECK_FALSE(p.player->ready());
  p.link->set(Link::Answer::kBytes);
  p.player->pause();
  REQUIRE(p.complete());
  CHECK(active_fingerprints(p.player->timeline(), p.player->seconds()) ==
        alive_in_file(p.player->seconds()));
}

TEST_CASE("damage costs its piece alone") {
  const SegmentInfo* base = nullptr;
  const SegmentInfo* harmonics = nullptr;
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.level < 0 && s.tier == 1) base = &s;
    if (s.level < 0 && s.tier == 0 && s.sh_bytes > 0) harmonics = &s;
  }
  REQUIRE(base != nullptr);
  REQUIRE(harmonics != nullptr);
  std::vector<std::uint8_t> bytes = clip().bytes;
  bytes[base->offset + base->bytes / 2] ^= 1;
  bytes[harmonics->sh_offset + harmonics->sh_bytes / 2] ^= 1;
  Playing p({}, bytes);
  REQUIRE(p.until([&] { return p.count(Kind::kDamaged) >= 2; }));
  REQUIRE(p.until([&] { return p.player->ready(); }));
  std::set<std::uint64_t> damaged;
  for (const PlayerEvent& event : p.events) {
    if (event.kind == Kind::kDamaged) damaged.insert(event.offset);
  }
  CHECK(damaged.contains(base->offset));
  CHECK(damaged.contains(harmonics->sh_offset));
  const auto active = p.player->timeline().at(0);
  REQUIRE(active.ok());
  const auto segment = static_cast<std::uint32_t>(harmonics - clip().reader->segments().data());
  CHECK(std::any_of(active->segments.begin(), active->segments.end(),
                    [&](const auto& part) { return part.segment == segment; }));
}

TEST_CASE("a moment is settled when nothing more of it comes, whole or not") {
  Playing sound;
  REQUIRE(sound.until([&] { return sound.player->is_complete(); }));
  CHECK(sound.player->layers() == sound.player->layer_count());

  const SegmentInfo* base = nullptr;
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.level < 0 && s.tier == 1) base = &s;
  }
  REQUIRE(base != nullptr);
  std::vector<std::uint8_t> bytes = clip().bytes;
  bytes[base->offset + base->bytes / 2] ^= 1;
  Playing damaged({}, bytes);
  REQUIRE(damaged.until([&] { return damaged.player->is_complete(); }));
  CHECK(damaged.count(Kind::kDamaged) > 0);
  CHECK(damaged.player->layers() == 1);
  CHECK(damaged.player->ready());

  PlayerSettings settings;
  settings.retry_seconds = 60;
  const auto lost = [](Link& link) { link.set(Link::Answer::kFail, clip().pieces_at); };
  Playing down(settings, clip().bytes, lost);
  REQUIRE(down.until([&] { return down.player->is_complete(); }));
  CHECK(down.player->layers() == 0);
  CHECK_FALSE(down.player->ready());

  const auto waits = [](Link& link) { link.set(Link::Answer::kWait, clip().pieces_at); };
  Playing waiting({}, clip().bytes, waits);
  waiting.until([&] { return !waiting.link->asked().empty(); });
  CHECK_FALSE(waiting.player->is_complete());
}

TEST_CASE("a moment is settled where memory has no room for the rest of it") {
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
    Playing p(settings);
    REQUIRE(p.until([&] { return p.player->is_complete(); }));
    CHECK(p.player->layers() < p.player->layer_count());
    // Room for all of another moment: what is said of the one does not hold for the other.
    REQUIRE(p.player->seek_frame(45).ok());
    REQUIRE(p.until([&] { return p.player->is_complete(); }));
  }
}

TEST_CASE("memory stays within its budget, and play comes to the end all the same") {
  PlayerSettings settings;
  std::uint64_t most = 0;
  for (double t = 0; t < kFrames; t += 1) {
    std::uint64_t alive = 0;
    for (const std::uint32_t s : clip().reader->segments_between(t, t)) {
      const SegmentInfo& segment = clip().reader->segments()[s];
      alive += segment.bytes + segment.sh_bytes + 260 * std::uint64_t{segment.primitives};
    }
    most = std::max(most, alive);
  }
  settings.memory_budget = most + most / 4;
  Playing p(settings);
  p.player->play();
  p.to_the_end([&] { CHECK(p.player->statistics().memory_bytes <= settings.memory_budget); });
  REQUIRE(p.complete());

  settings.memory_budget = 1000;
  Playing none(settings);
  REQUIRE(none.until([&] { return none.count(Kind::kReadFailed) > 0; }));
  CHECK(none.said(Kind::kReadFailed, "memory"));
}

TEST_CASE("play goes backwards and round") {
  Playing p;
  REQUIRE(p.player->seek_frame(89).ok());
  REQUIRE(p.player->set_rate(-2).ok());
  p.player->play();
  double last = 1e9;
  p.to_the_end([&] {
    CHECK(p.player->seconds() <= last);
    last = p.player->seconds();
  });
  CHECK(p.player->seconds() == 0);
  p.player->set_loop(true);
  REQUIRE(p.player->set_rate(4).ok());
  p.player->play();
  REQUIRE(p.until([&] {
    p.now += 1.0 / 30;
    return p.count(Kind::kLooped) >= 3;
  }));
}

TEST_CASE("all layers of a moment come, however patient the layers are") {
  PlayerSettings settings;
  settings.layer_lead_seconds = 60;
  settings.prefetch_seconds = 0.5;
  Playing p(settings);
  REQUIRE(p.complete());
}

TEST_CASE("who stands still gets every layer, however slow the link is") {
  Playing p({}, clip().bytes, [](Link& link) {
    link.limit(static_cast<double>(clip().bytes.size()), clip().pieces_at);  // all in a second
  });
  REQUIRE(p.player->seek_frame(89).ok());
  REQUIRE(p.complete());
  REQUIRE(p.player->seek_frame(40).ok());
  REQUIRE(p.complete());
}

TEST_CASE("a link that has become better is used, whatever it was before") {
  PlayerSettings settings;
  settings.retry_seconds = 0.01;
  settings.prefetch_seconds = 0.5;
  Playing p(settings, clip().bytes, [](Link& link) { link.limit(20000, clip().pieces_at); });
  p.player->set_loop(true);
  p.player->play();
  REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
  p.link->limit(0, 0);
  REQUIRE(p.until([&] {
    p.now += 0.01;
    return p.player->layers() == p.player->layer_count();
  }));
}

TEST_CASE("a jump away from a read that does not end is not held up by it") {
  PlayerSettings settings;
  settings.max_reads_in_flight = 2;
  const SegmentInfo* there = nullptr;  // of the end alone
  for (const SegmentInfo& s : clip().reader->segments()) {
    if (s.tier == 0 && s.level >= 0 && s.begin_ticks >= 60) there = &s;
  }
  REQUIRE(there != nullptr);
  settings.prefetch_seconds = 0.2;
  Playing p(settings, clip().bytes, [&](Link& link) {
    link.set(Link::Answer::kWait, there->offset, there->offset + there->bytes);
  });
  REQUIRE(p.player->seek_frame(static_cast<std::uint32_t>(there->begin_ticks) + 2).ok());
  REQUIRE(p.until([&] {
    const auto asked = p.link->asked();
    return std::find(asked.begin(), asked.end(), there->offset) != asked.end();
  }));
  REQUIRE(p.player->seek_frame(5).ok());
  p.player->play();
  REQUIRE(p.until([&] { return p.player->state() == PlayerState::kPlaying; }));
}

TEST_CASE("however little memory there is, play comes to the end, and says what it lacks") {
  std::uint64_t most = 0;
  for (double t = 0; t < kFrames; t += 1) {
    std::uint64_t base = 0;
    for (const std::uint32_t s : clip().reader->segments_between(t, t)) {
      const SegmentInfo& segment = clip().reader->segments()[s];
      if (segment.tier == 0) base += segment.bytes + decoded_segment_bytes(segment.primitives, 2);
    }
    most = std::max(most, base);
  }
  for (const double share : {0.3, 0.7, 1.02, 1.1, 1.5}) {
    INFO(share);
    PlayerSettings settings;
    settings.retry_seconds = 0.01;
    settings.memory_budget = static_cast<std::uint64_t>(share * static_cast<double>(most));
    Playing p(settings);
    p.player->play();
    p.to_the_end([&] { CHECK(p.player->statistics().memory_bytes <= settings.memory_budget); });
    if (share < 1) CHECK(p.said(Kind::kReadFailed, "memory"));
  }
}

TEST_CASE("play that goes round waits at the end for the beginning, once") {
  PlayerSettings settings;
  settings.prefetch_seconds = 0.3;
  settings.memory_budget = 600'000;
  Playing p(settings);
  REQUIRE(p.player->seek_frame(80).ok());
  REQUIRE(p.complete());
  p.player->set_loop(true);
  p.link->set(Link::Answer::kWait, clip().pieces_at);
  p.player->play();
  for (int k = 0; k < 200; ++k) {
    p.until([] { return true; });
    p.now += 0.02;
  }
  CHECK(p.count(Kind::kBuffering) <= 2);
  p.link->set(Link::Answer::kBytes);
  REQUIRE(p.until([&] {
    p.now += 0.02;
    return p.count(Kind::kLooped) > 0;
  }));
}

TEST_CASE("a frame's time is the frame's, at every rate") {
  for (const TimeBase base : {TimeBase{1, 30}, {1001, 24000}, {1001, 30000}, {1, 25}, {1, 1000}}) {
    for (std::uint32_t frame = 0; frame < 100000; frame += 7) {
      REQUIRE(base.ticks(base.seconds(frame)) == frame);
    }
    CHECK(base.ticks(base.seconds(1234.5)) == Approx(1234.5).epsilon(1e-15));
  }
}

TEST_CASE("a player ends at once while its reads wait") {
  const auto begin = std::chrono::steady_clock::now();
  {
    Playing p({}, clip().bytes,
              [](Link& link) { link.set(Link::Answer::kWait, clip().pieces_at); });
    REQUIRE(p.until([&] { return p.link->asked().back() >= clip().pieces_at; }));
  }
  CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(20));
}

}  // namespace
}  // namespace stgs::player
