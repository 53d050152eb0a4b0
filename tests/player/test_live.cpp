// SPDX-License-Identifier: Apache-2.0
// Playing a recording while it grows.
#include "live_fixture.h"
#include "stream/snapshot_source.h"

namespace stgs::player {
namespace {

using namespace live;

TEST_CASE("a viewer joins in the middle, follows the edge, sees all and comes to the end") {
  Viewer viewer(6);
  CHECK(viewer.player->live().growing);
  CHECK(viewer.player->live().following);
  CHECK(viewer.player->seconds() == Approx(6 * kStretch - 0.5).margin(kFrame));
  viewer.play();
  const int waits = viewer.count(Kind::kBuffering);  // for what play began with
  const double joined = viewer.player->seconds();
  std::set<int> seen;
  double last = joined;
  const auto look = [&] {
    const double moment = viewer.player->seconds();
    CHECK(moment > last);
    CHECK(moment < last + 1.2 * kFrame);  // no jump: a tenth faster at most
    last = moment;
    seen.insert(static_cast<int>(moment / kStretch));
    REQUIRE(viewer.player->ready());
  };
  for (std::uint32_t i = 7; i <= kStretches; ++i) {
    viewer.next_stretch(i, look);
    const LiveState live = viewer.player->live();
    CHECK(live.following);
    CHECK(live.latency_seconds == Approx(live.target_latency_seconds).margin(0.1));
    const double moment = viewer.player->seconds();
    REQUIRE(viewer.until([&] { return viewer.player->is_complete(); }));
    CHECK(active_fingerprints(viewer.player->timeline(), moment) == alive_in_file(moment));
  }
  for (int i = static_cast<int>(joined / kStretch); i < static_cast<int>(kStretches) - 1; ++i) {
    CHECK(seen.count(i) == 1);
  }
  CHECK(viewer.count(Kind::kBuffering) == waits);
  viewer.file->grow(recording().closed());
  REQUIRE(viewer.until([&] { return !viewer.player->live().growing; }));
  CHECK(viewer.count(Kind::kFinished) == 1);
  viewer.frames(30);
  CHECK(viewer.player->state() == PlayerState::kEnded);
  CHECK(viewer.player->seconds() == Approx(kStretches * kStretch - kFrame).margin(kFrame));
  CHECK(viewer.count(Kind::kEnded) == 1);
  // A clip like any other now.
  viewer.player->play();
  REQUIRE(viewer.until([&] { return viewer.player->ready(); }));
  CHECK(viewer.player->seconds() == 0);
}

TEST_CASE("play that runs ahead of the edge stands still, says so, and goes on") {
  Viewer viewer(6);
  viewer.play();
  const int waits = viewer.count(Kind::kBuffering);
  viewer.frames(40);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  CHECK(viewer.count(Kind::kBuffering) == waits + 1);
  const double stood = viewer.player->seconds();
  CHECK(stood < 6 * kStretch);
  CHECK(stood > 6 * kStretch - 1.5 * kFrame);
  viewer.file->grow(recording().ends[8]);
  REQUIRE(viewer.until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  CHECK(viewer.count(Kind::kResumed) == waits + 1);
  viewer.frames(3);
  CHECK(viewer.player->seconds() > stood);
}

TEST_CASE("what has been recorded can be paused in and sought, and the edge found again") {
  Viewer viewer(9);
  viewer.play();
  viewer.next_stretch(10);
  viewer.player->pause();
  CHECK_FALSE(viewer.player->live().following);
  const double paused = viewer.player->seconds();
  viewer.next_stretch(11);
  viewer.next_stretch(12);
  CHECK(viewer.player->seconds() == paused);
  CHECK(viewer.player->live().growing);
  REQUIRE(viewer.player->seek_frame(7).ok());
  CHECK(viewer.player->seek_frame(12 * testing::kFragmentFrames).code() == StatusCode::kUsage);
  REQUIRE(viewer.until([&] { return viewer.player->is_complete(); }));
  CHECK(active_fingerprints(viewer.player->timeline(), viewer.player->seconds()) ==
        alive_in_file(7 * kFrame));
  viewer.play();
  REQUIRE(viewer.until([&] { return viewer.has(7 * kFrame, 18 * kFrame); }));
  viewer.frames(10);
  CHECK(viewer.player->seconds() == Approx(17 * kFrame).margin(1e-6));  // as fast as it is
  CHECK_FALSE(viewer.player->live().following);
  viewer.player->go_live();
  REQUIRE(viewer.until([&] { return viewer.player->state() == PlayerState::kPlaying; }));
  const LiveState live = viewer.player->live();
  CHECK(live.following);
  CHECK(live.latency_seconds == Approx(live.target_latency_seconds).margin(0.05));
  // Further than the edge is the edge; and who plays there faster comes to follow it.
  REQUIRE(viewer.player->seek(1e6).ok());
  viewer.tick();
  CHECK(viewer.player->seconds() < 12 * kStretch);
  REQUIRE(viewer.player->seek(10 * kStretch).ok());
  REQUIRE(viewer.player->set_rate(4).ok());
  viewer.play();
  viewer.frames(10);
  CHECK(viewer.player->live().following);
}

TEST_CASE("a distance to the edge is made up for a tenth faster, a great one by a jump") {
  PlayerSettings settings = quick();
  settings.live.skip_seconds = 1;
  Viewer viewer(6, settings);
  viewer.play();
  for (std::uint32_t i = 7; i <= 10; ++i) viewer.next_stretch(i);
  // The application stands still for a second, of which it plays .25 s.
  viewer.now += 1;
  viewer.tick();
  viewer.file->grow(recording().ends[13]);
  REQUIRE(viewer.at_edge_of(13));
  viewer.wait_for(13 * kStretch);
  const LiveState live = viewer.player->live();
  CHECK(live.latency_seconds - live.target_latency_seconds == Approx(0.75).margin(0.1));
  const double before = viewer.player->seconds();
  viewer.next_stretch(14);
  const double passed = viewer.player->seconds() - before;
  CHECK(passed > 1.03 * kStretch);
  CHECK(passed < 1.1 * kStretch + 1e-6);
  CHECK(viewer.count(Kind::kSkipped) == 0);
  // And for longer than is made up for.
  viewer.now += 4 * kStretch;
  viewer.tick();
  viewer.file->grow(recording().ends[kStretches]);
  REQUIRE(viewer.at_edge_of(kStretches));
  REQUIRE(viewer.until([&] { return viewer.count(Kind::kSkipped) == 1; }));
  const LiveState skipped = viewer.player->live();
  CHECK(skipped.latency_seconds < skipped.target_latency_seconds + 1.01);
}

TEST_CASE("nothing of a recording that grows is read twice") {
  Viewer viewer(3);
  viewer.play();
  for (std::uint32_t i = 4; i <= kStretches; ++i) viewer.next_stretch(i);
  viewer.file->grow(recording().closed());
  REQUIRE(viewer.until([&] { return !viewer.player->live().growing; }));
  std::vector<int> times(recording().bytes.size());
  for (const Growth::Read& read : viewer.file->reads()) {
    for (std::uint64_t k = 0; k < read.bytes; ++k) ++times[read.offset + k];
  }
  const auto body = times.begin() + static_cast<std::ptrdiff_t>(recording().ends[0]);
  CHECK(*std::max_element(body, times.end()) == 1);
}

TEST_CASE("what opening a reader has read of the index is not read again, and does not pile up") {
  const auto file = std::make_shared<Growth>();
  file->grow(recording().ends[1]);
  const auto source = std::make_shared<RangeSource>(std::make_unique<GrowingSource>(file),
                                                    std::pmr::get_default_resource());
  IndexCache cache;
  std::uint64_t before = 0, most = 0;
  for (std::uint32_t i = 1; i <= kStretches; ++i) {
    file->grow(recording().ends[i]);
    REQUIRE(source->refresh(0).ok());
    const auto reader =
        open_snapshot(source, cache, ReadLimits{}, std::pmr::get_default_resource());
    REQUIRE(reader.ok());
    CHECK((*reader)->metadata().frames == i * testing::kFragmentFrames);
    const auto reads = file->reads();
    for (std::size_t k = before; k < reads.size() && i > 1; ++k) {
      CHECK(reads[k].offset >= recording().ends[i - 1]);
    }
    before = reads.size();
    most = std::max(most, cache.bytes());
    CHECK(cache.bytes() <= recording().ends[i]);
  }
  CHECK(most > 0);
}

TEST_CASE("memory stays within its budget however long a recording is followed") {
  PlayerSettings settings = quick();
  settings.memory_budget = recording().bytes.size() / 2;
  Viewer viewer(3, settings);
  viewer.player->play();
  std::uint64_t most = 0;
  for (std::uint32_t i = 4; i <= kStretches; ++i) {
    viewer.file->grow(recording().ends[i]);
    REQUIRE(viewer.at_edge_of(i));
    viewer.frames(testing::kFragmentFrames, [&] {
      const double at = viewer.player->seconds();
      const double next = std::min(at + 2 * kFrame, i * kStretch - 1e-6);
      REQUIRE(viewer.until(
          [&] { return viewer.has(at, next) && viewer.player->state() == PlayerState::kPlaying; }));
      most = std::max(most, viewer.player->statistics().memory_bytes);
    });
  }
  CHECK(most <= settings.memory_budget);
  CHECK(most > settings.memory_budget / 4);
  CHECK(viewer.player->seconds() > (kStretches - 6) * kStretch);
}

TEST_CASE("a recording that does not grow is a clip like any other") {
  SECTION("as it is asked for") {
    PlayerSettings settings = quick();
    settings.live.follow = false;
    Viewer viewer(6, settings);
    CHECK_FALSE(viewer.player->live().growing);
    CHECK(viewer.player->seconds() == 0);
    viewer.play();
    viewer.file->grow(recording().ends[9]);
    REQUIRE(viewer.until([&] { return viewer.has(0, 6 * kStretch); }));
    viewer.frames(70);
    CHECK(viewer.player->state() == PlayerState::kEnded);
    CHECK(viewer.player->seconds() == Approx(6 * kStretch - kFrame));
  }
  SECTION("closed") {
    Viewer viewer(kStretches);
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

TEST_CASE("a recording is joined before its first stretch") {
  Viewer viewer(0);
  viewer.player->play();
  viewer.frames(5);
  CHECK(viewer.player->state() == PlayerState::kBuffering);
  CHECK(viewer.player->seconds() == 0);
  for (std::uint32_t i = 1; i <= 5; ++i) {
    viewer.file->grow(recording().ends[i]);
    REQUIRE(viewer.at_edge_of(i));
    viewer.wait_for(i * kStretch);
    viewer.frames(testing::kFragmentFrames);
  }
  CHECK(viewer.player->seconds() > kStretch);
  CHECK(viewer.player->live().following);
}

}  // namespace
}  // namespace stgs::player
