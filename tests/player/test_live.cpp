// SPDX-License-Identifier: Apache-2.0
// Playback of a recording while it grows.
#include "live_fixture.h"
#include "stream/snapshot_source.h"

namespace stgs::player {
namespace {

using namespace live;

TEST_CASE("a viewer joins in the middle, follows the edge without gaps and reaches the end") {
  Viewer viewer(6);
  CHECK(viewer.player->live().growing);
  CHECK(viewer.player->live().following);
  CHECK(viewer.player->seconds() == Approx(6 * kFragmentSeconds - 0.5).margin(kFrameSeconds));
  viewer.play();
  const int stalls = viewer.count(Kind::kBuffering);  // before playback began
  const double joined = viewer.player->seconds();
  std::set<int> seen;
  double last = joined;
  const auto look = [&] {
    const double at = viewer.player->seconds();
    CHECK(at > last);
    CHECK(at < last + 1.2 * kFrameSeconds);  // no jump: at most 10 % faster
    last = at;
    seen.insert(static_cast<int>(at / kFragmentSeconds));
    REQUIRE(viewer.player->ready());
  };
  for (std::uint32_t i = 7; i <= kFragments; ++i) {
    viewer.next_fragment(i, look);
    const LiveState live = viewer.player->live();
    CHECK(live.following);
    CHECK(live.latency_seconds == Approx(live.target_latency_seconds).margin(0.1));
    const double at = viewer.player->seconds();
    REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
    CHECK(active_fingerprints(viewer.player->timeline(), at) == active_in_file(at));
  }
  for (int i = static_cast<int>(joined / kFragmentSeconds); i < static_cast<int>(kFragments) - 1;
       ++i) {
    CHECK(seen.count(i) == 1);
  }
  CHECK(viewer.count(Kind::kBuffering) == stalls);
  viewer.file->grow(recording().closed());
  REQUIRE(viewer.wait_until([&] { return !viewer.player->live().growing; }));
  CHECK(viewer.count(Kind::kFinished) == 1);
  viewer.frames(30);
  CHECK(viewer.player->state() == PlayerState::kEnded);
  CHECK(viewer.player->seconds() ==
        Approx(kFragments * kFragmentSeconds - kFrameSeconds).margin(kFrameSeconds));
  CHECK(viewer.count(Kind::kEnded) == 1);
  // It is a finished clip now.
  viewer.player->play();
  REQUIRE(viewer.wait_until([&] { return viewer.player->ready(); }));
  CHECK(viewer.player->seconds() == 0);
}

TEST_CASE("playback that reaches the edge stalls, reports it, and resumes") {
  Viewer viewer(6);
  viewer.play();
  const int stalls = viewer.count(Kind::kBuffering);
  viewer.frames(40);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  CHECK(viewer.count(Kind::kBuffering) == stalls + 1);
  const double stalled_at = viewer.player->seconds();
  CHECK(stalled_at < 6 * kFragmentSeconds);
  CHECK(stalled_at > 6 * kFragmentSeconds - 1.5 * kFrameSeconds);
  viewer.file->grow(recording().ends[8]);
  REQUIRE(viewer.wait_until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  CHECK(viewer.count(Kind::kResumed) == stalls + 1);
  viewer.frames(3);
  CHECK(viewer.player->seconds() > stalled_at);
}

TEST_CASE("a growing recording can be paused and sought, and followed again") {
  Viewer viewer(9);
  viewer.play();
  viewer.next_fragment(10);
  viewer.player->pause();
  CHECK_FALSE(viewer.player->live().following);
  const double paused = viewer.player->seconds();
  viewer.next_fragment(11);
  viewer.next_fragment(12);
  CHECK(viewer.player->seconds() == paused);
  CHECK(viewer.player->live().growing);
  REQUIRE(viewer.player->seek_frame(7).ok());
  CHECK(viewer.player->seek_frame(12 * testing::kFragmentFrames).code() == StatusCode::kUsage);
  REQUIRE(viewer.wait_until([&] { return viewer.player->is_complete(); }));
  CHECK(active_fingerprints(viewer.player->timeline(), viewer.player->seconds()) ==
        active_in_file(7 * kFrameSeconds));
  viewer.play();
  REQUIRE(viewer.wait_until([&] { return viewer.has(7 * kFrameSeconds, 18 * kFrameSeconds); }));
  viewer.frames(10);
  CHECK(viewer.player->seconds() == Approx(17 * kFrameSeconds).margin(1e-6));  // at rate 1
  CHECK_FALSE(viewer.player->live().following);
  viewer.player->go_live();
  REQUIRE(viewer.wait_until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  const LiveState live = viewer.player->live();
  CHECK(live.following);
  CHECK(live.latency_seconds == Approx(live.target_latency_seconds).margin(0.05));
  // A seek past the edge follows it, and so does playback that catches up with it.
  REQUIRE(viewer.player->seek(1e6).ok());
  viewer.tick();
  CHECK(viewer.player->seconds() < 12 * kFragmentSeconds);
  REQUIRE(viewer.player->seek(10 * kFragmentSeconds).ok());
  REQUIRE(viewer.player->set_rate(4).ok());
  viewer.play();
  viewer.frames(10);
  CHECK(viewer.player->live().following);
}

TEST_CASE("a delay is caught up 10 % faster, a long one by a jump") {
  PlayerSettings settings = quick();
  settings.live.skip_seconds = 1;
  Viewer viewer(6, settings);
  viewer.play();
  for (std::uint32_t i = 7; i <= 10; ++i) viewer.next_fragment(i);
  // The application stalls for 1 s, of which 0.25 s are played.
  viewer.now += 1;
  viewer.tick();
  viewer.file->grow(recording().ends[13]);
  REQUIRE(viewer.wait_for_edge(13));
  viewer.wait_for(13 * kFragmentSeconds);
  const LiveState live = viewer.player->live();
  CHECK(live.latency_seconds - live.target_latency_seconds == Approx(0.75).margin(0.1));
  const double before = viewer.player->seconds();
  viewer.next_fragment(14);
  const double passed = viewer.player->seconds() - before;
  CHECK(passed > 1.03 * kFragmentSeconds);
  CHECK(passed < 1.1 * kFragmentSeconds + 1e-6);
  CHECK(viewer.count(Kind::kSkipped) == 0);
  // A longer delay than is caught up.
  viewer.now += 4 * kFragmentSeconds;
  viewer.tick();
  viewer.file->grow(recording().ends[kFragments]);
  REQUIRE(viewer.wait_for_edge(kFragments));
  REQUIRE(viewer.wait_until([&] { return viewer.count(Kind::kSkipped) == 1; }));
  const LiveState skipped = viewer.player->live();
  CHECK(skipped.latency_seconds < skipped.target_latency_seconds + 1.01);
}

// Offsets of the FRAG records of the recording.
std::vector<std::uint64_t> fragment_records() {
  const std::string text(recording().bytes.begin(), recording().bytes.end());
  std::vector<std::uint64_t> out;
  for (std::uint32_t i = 1; i <= kFragments; ++i)
    out.push_back(text.rfind("FRAG", recording().ends[i] - 1));
  return out;
}

TEST_CASE("no byte of a growing recording is read twice, except the index of the last fragment") {
  Viewer viewer(3);
  viewer.play();
  for (std::uint32_t i = 4; i <= kFragments; ++i) viewer.next_fragment(i);
  viewer.file->grow(recording().closed());
  REQUIRE(viewer.wait_until([&] { return !viewer.player->live().growing; }));
  std::vector<int> times(recording().bytes.size());
  for (const Growth::Read& read : viewer.file->reads()) {
    for (std::uint64_t k = 0; k < read.bytes; ++k) ++times[read.offset + k];
  }
  const std::vector<std::uint64_t> indices = fragment_records();
  for (std::uint32_t i = 1; i <= kFragments; ++i) {
    const auto at = [&times](std::uint64_t offset) {
      return times.begin() + static_cast<std::ptrdiff_t>(offset);
    };
    CHECK(*std::max_element(at(recording().ends[i - 1]), at(indices[i - 1])) == 1);
    CHECK(*std::max_element(at(indices[i - 1]), at(recording().ends[i])) <= 2);
  }
}

TEST_CASE("the bytes of the index are cached for the next reader, and no others") {
  const auto file = std::make_shared<Growth>();
  file->grow(recording().ends[1]);
  const auto source = std::make_shared<RangeSource>(std::make_unique<GrowingSource>(file),
                                                    std::pmr::get_default_resource());
  IndexCache cache;
  const std::vector<std::uint64_t> indices = fragment_records();
  std::uint64_t before = 0, peak = 0;
  for (std::uint32_t i = 1; i <= kFragments; ++i) {
    file->grow(recording().ends[i]);
    REQUIRE(source->refresh(0).ok());
    const auto reader = open_snapshot(source, cache, ReadLimits{}, std::pmr::get_default_resource(),
                                      IndexLoading::kComplete);
    REQUIRE(reader.ok());
    CHECK((*reader)->metadata().frames == i * testing::kFragmentFrames);
    const auto reads = file->reads();
    for (std::size_t k = before; k < reads.size() && i > 1; ++k) {
      CHECK(reads[k].offset >= indices[i - 2]);
    }
    before = reads.size();
    peak = std::max(peak, cache.bytes());
    CHECK(cache.bytes() <= recording().ends[i]);
  }
  CHECK(peak > 0);
}

TEST_CASE("following a recording stays within the memory budget") {
  PlayerSettings settings = quick();
  settings.memory_budget = recording().bytes.size() / 2;
  Viewer viewer(3, settings);
  viewer.player->play();
  std::uint64_t peak = 0;
  for (std::uint32_t i = 4; i <= kFragments; ++i) {
    viewer.file->grow(recording().ends[i]);
    REQUIRE(viewer.wait_for_edge(i));
    viewer.frames(testing::kFragmentFrames, [&] {
      const double at = viewer.player->seconds();
      const double next = std::min(at + 2 * kFrameSeconds, i * kFragmentSeconds - 1e-6);
      REQUIRE(viewer.wait_until(
          [&] { return viewer.has(at, next) && viewer.player->state() == PlayerState::kPlaying; }));
      peak = std::max(peak, viewer.player->statistics().memory_bytes);
    });
  }
  CHECK(peak <= settings.memory_budget);
  CHECK(peak > settings.memory_budget / 4);
  CHECK(viewer.player->seconds() > (kFragments - 6) * kFragmentSeconds);
}

TEST_CASE("a recording that does not grow plays as a finished clip") {
  SECTION("following disabled") {
    PlayerSettings settings = quick();
    settings.live.follow = false;
    Viewer viewer(6, settings);
    CHECK_FALSE(viewer.player->live().growing);
    CHECK(viewer.player->seconds() == 0);
    viewer.play();
    viewer.file->grow(recording().ends[9]);
    REQUIRE(viewer.wait_until([&] { return viewer.has(0, 6 * kFragmentSeconds); }));
    viewer.frames(70);
    CHECK(viewer.player->state() == PlayerState::kEnded);
    CHECK(viewer.player->seconds() == Approx(6 * kFragmentSeconds - kFrameSeconds));
  }
  SECTION("closed") {
    Viewer viewer(kFragments);
    viewer.file->grow(recording().closed());
    auto opened = Player::from_source(std::make_unique<GrowingSource>(viewer.file), quick());
    REQUIRE(opened.ok());
    CHECK_FALSE((*opened)->live().growing);
    CHECK((*opened)->seconds() == 0);
  }
  SECTION("in memory") {
    Bytes bytes = recording().bytes;
    bytes.resize(recording().ends[6]);
    auto opened = Player::from_source(memory_source(std::move(bytes)), quick());
    REQUIRE(opened.ok());
    CHECK_FALSE((*opened)->live().growing);
  }
}

TEST_CASE("a recording is joined before its first fragment") {
  Viewer viewer(0);
  viewer.player->play();
  viewer.frames(5);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  CHECK(viewer.player->seconds() == 0);
  for (std::uint32_t i = 1; i <= 5; ++i) {
    viewer.file->grow(recording().ends[i]);
    REQUIRE(viewer.wait_for_edge(i));
    viewer.wait_for(i * kFragmentSeconds);
    viewer.frames(testing::kFragmentFrames);
  }
  CHECK(viewer.player->seconds() > kFragmentSeconds);
  CHECK(viewer.player->live().following);
}

}  // namespace
}  // namespace stgs::player
