// SPDX-License-Identifier: Apache-2.0
// The state machine of playback: every pair of a state and an event.
#include <cmath>
#include <limits>
#include <string>

#include "catch.h"
#include "stream/playback.h"

namespace stgs::player {
namespace {

constexpr std::uint32_t kFrames = 90;  // 3 s
constexpr TimeBase kTimeBase{1, 30};

// Data that is available completely or not at all.
class FakeData final : public Availability {
 public:
  ClipExtent extent() const override { return file; }
  bool ready(double) const override { return available; }
  std::vector<TickRange> ready_ranges() const override {
    if (!available) return {};
    return {{0, double(file.frames)}};
  }
  // A recording with fragments of half a second.
  void grow(std::uint32_t frames) {
    file = {frames, true, 1000 + std::uint64_t{frames}, frames - 15.0};
  }

  ClipExtent file{kFrames, false, 1000, 0};
  bool available = true;
};

struct Machine {
  explicit Machine(bool live = false) : playback(make(live)) { playback.take_effects(); }

  Playback make(bool live) {
    if (live) data.grow(kFrames);
    PlayerSettings settings;
    settings.live.latency_seconds = 0.6;
    return Playback(settings, kTimeBase, data.file, live);
  }
  // Returns the events, a letter each.
  std::string step(double passed, bool available = true) {
    data.available = available;
    playback.step(now += passed, data);
    return events();
  }
  std::string events() {
    effects = playback.take_effects();
    std::string out;
    for (std::size_t k = 0; k < effects.event_count; ++k) {
      switch (effects.events[k].kind) {
        case PlayerEvent::Kind::kBuffering:
          out += 'B';
          break;
        case PlayerEvent::Kind::kResumed:
          out += 'R';
          break;
        case PlayerEvent::Kind::kLooped:
          out += 'L';
          break;
        case PlayerEvent::Kind::kEnded:
          out += 'E';
          break;
        case PlayerEvent::Kind::kSkipped:
          out += 'S';
          break;
        case PlayerEvent::Kind::kFinished:
          out += 'F';
          break;
        default:
          out += '?';
      }
    }
    return out;
  }

  FakeData data;
  double now = 100;
  Playback playback;
  Playback::Effects effects;
};

// A clip in a state, 5 frames before its end, or at its end.
Machine clip_in(PlayState state) {
  Machine m;
  REQUIRE(m.playback.seek_frame(85).ok());
  m.step(0.01);
  if (state != PlayState::kPaused) m.playback.play();
  if (state == PlayState::kStalled || state == PlayState::kPausedInStall) m.step(0.01, false);
  if (state == PlayState::kPausedInStall) m.playback.pause();
  if (state == PlayState::kPlaying || state == PlayState::kEnded) m.step(0.01);
  if (state == PlayState::kEnded) m.step(0.25);
  REQUIRE(m.playback.play_state() == state);
  m.playback.take_effects();
  return m;
}

TEST_CASE("every event changes the play state of a clip as listed") {
  using S = PlayState;
  struct Row {
    S from;
    S play, pause, seek, no_data, data, to_end;  // the state after each event
    std::string no_data_events, data_events, to_end_events;
  };
  const Row rows[] = {
      {S::kPaused, S::kStarting, S::kPaused, S::kPaused, S::kPaused, S::kPaused, S::kPaused, "", "",
       ""},
      {S::kPausedInStall, S::kStalled, S::kPausedInStall, S::kPausedInStall, S::kPausedInStall,
       S::kPausedInStall, S::kPausedInStall, "", "", ""},
      {S::kStarting, S::kStarting, S::kPaused, S::kStarting, S::kStalled, S::kPlaying, S::kEnded,
       "B", "", "E"},
      {S::kPlaying, S::kPlaying, S::kPaused, S::kStarting, S::kStalled, S::kPlaying, S::kEnded, "B",
       "", "E"},
      {S::kStalled, S::kStalled, S::kPausedInStall, S::kStalled, S::kStalled, S::kPlaying,
       S::kEnded, "", "R", "RE"},
      {S::kEnded, S::kStarting, S::kPaused, S::kPaused, S::kEnded, S::kEnded, S::kEnded, "", "",
       ""},
  };
  for (const Row& row : rows) {
    CAPTURE(static_cast<int>(row.from));
    const auto after = [&](const auto& event) {
      Machine m = clip_in(row.from);
      event(m);
      CHECK(m.playback.follow_state() == FollowState::kNone);
      return m.playback.play_state();
    };
    CHECK(after([](Machine& m) { m.playback.play(); }) == row.play);
    CHECK(after([](Machine& m) { m.playback.pause(); }) == row.pause);
    CHECK(after([](Machine& m) { CHECK(m.playback.seek(0.5).ok()); }) == row.seek);
    CHECK(after([](Machine& m) { CHECK(m.playback.seek_frame(5).ok()); }) == row.seek);
    CHECK(after([&](Machine& m) { CHECK(m.step(0.01, false) == row.no_data_events); }) ==
          row.no_data);
    CHECK(after([&](Machine& m) { CHECK(m.step(0.01) == row.data_events); }) == row.data);
    CHECK(after([&](Machine& m) { CHECK(m.step(0.25) == row.to_end_events); }) == row.to_end);
    CHECK(after([](Machine& m) { CHECK(m.playback.set_rate(2).ok()); }) == row.from);
    CHECK(after([](Machine& m) { m.playback.set_loop(true); }) == row.from);
    CHECK(after([](Machine& m) { m.playback.go_live(); }) == row.from);
    CHECK(after([](Machine& m) { CHECK_FALSE(m.playback.seek_frame(kFrames).ok()); }) == row.from);
  }
}

// A recording in a state, whose position is near its target or, if detached, at frame 7.
Machine recording_in(FollowState state, bool playing) {
  Machine m(true);
  if (playing) m.playback.play();
  m.step(0.01);
  if (state == FollowState::kJoining) m.playback.go_live();
  if (state == FollowState::kDetached) CHECK(m.playback.seek_frame(7).ok());
  if (state == FollowState::kDetached && playing) m.step(0.01);
  REQUIRE(m.playback.follow_state() == state);
  REQUIRE(m.playback.live().following == (state != FollowState::kDetached));
  m.playback.take_effects();
  return m;
}

TEST_CASE("every event changes the follow state of a recording as listed") {
  using F = FollowState;
  struct Row {
    F from;
    bool playing;
    F play, pause, step;  // the state after each event
  };
  const Row rows[] = {
      {F::kDetached, false, F::kDetached, F::kDetached, F::kDetached},
      {F::kDetached, true, F::kDetached, F::kDetached, F::kDetached},
      {F::kFollowing, false, F::kJoining, F::kFollowing, F::kFollowing},
      {F::kFollowing, true, F::kFollowing, F::kDetached, F::kFollowing},
      {F::kJoining, false, F::kJoining, F::kJoining, F::kFollowing},
      {F::kJoining, true, F::kJoining, F::kDetached, F::kFollowing},
  };
  for (const Row& row : rows) {
    CAPTURE(static_cast<int>(row.from), row.playing);
    const auto after = [&](const auto& event) {
      Machine m = recording_in(row.from, row.playing);
      event(m);
      return m.playback.follow_state();
    };
    CHECK(after([](Machine& m) { m.playback.play(); }) == row.play);
    CHECK(after([](Machine& m) { m.playback.pause(); }) == row.pause);
    CHECK(after([](Machine& m) { m.step(0.01); }) == row.step);
    CHECK(after([](Machine& m) { CHECK(m.playback.seek(0.5).ok()); }) == F::kDetached);
    CHECK(after([](Machine& m) { CHECK(m.playback.seek_frame(5).ok()); }) == F::kDetached);
    CHECK(after([](Machine& m) { CHECK(m.playback.seek(1e6).ok()); }) == F::kJoining);
    CHECK(after([](Machine& m) { m.playback.go_live(); }) == F::kJoining);
    CHECK(after([](Machine& m) { CHECK(m.playback.set_rate(1).ok()); }) == row.from);
    CHECK(after([](Machine& m) { CHECK(m.playback.set_rate(-1).ok()); }) == F::kDetached);
    CHECK(after([](Machine& m) { m.playback.set_loop(true); }) == row.from);
    CHECK(after([](Machine& m) {
            m.data.file.growing = false;
            m.data.file.file_bytes += 1;
            CHECK(m.step(0.01).find('F') != std::string::npos);
            CHECK_FALSE(m.playback.live().growing);
          }) == F::kNone);
  }
}

TEST_CASE("a detached position that catches up with the edge follows it at rate 1") {
  Machine m = recording_in(FollowState::kDetached, true);
  REQUIRE(m.playback.set_rate(4).ok());
  for (int k = 0; k < 100 && m.playback.follow_state() == FollowState::kDetached; ++k) m.step(0.02);
  CHECK(m.playback.follow_state() == FollowState::kFollowing);
  m.step(0.01);
  CHECK(m.effects.playhead->ticks_per_second == 30);
}

TEST_CASE("a position that falls too far behind the edge jumps") {
  Machine m = recording_in(FollowState::kFollowing, true);
  m.data.grow(kFrames + 300);
  const std::string events = m.step(1);  // too long to measure when the fragments arrived
  CHECK(events.front() == 'S');
  CHECK(m.effects.jumped);
  CHECK(m.playback.follow_state() == FollowState::kFollowing);
  CHECK(m.playback.seconds() > 12);
}

TEST_CASE("a new latency changes the rate at the edge, or the position when it is joined") {
  Machine m = recording_in(FollowState::kFollowing, true);
  const double before = m.playback.seconds();
  REQUIRE(m.playback.set_live_latency(1.5).ok());
  m.step(0.01);
  CHECK_FALSE(m.effects.jumped);
  CHECK(m.playback.live().target_latency_seconds == Approx(1.5));
  CHECK(m.playback.seconds() == Approx(before + 0.009));
  m.playback.go_live();
  m.step(0.01);
  CHECK(m.playback.live().latency_seconds == Approx(1.5).margin(0.02));
  for (const double invalid : {-0.1, std::numeric_limits<double>::infinity(), std::nan("")}) {
    CHECK(m.playback.set_live_latency(invalid).code() == StatusCode::kUsage);
  }
  CHECK(m.playback.live().target_latency_seconds == Approx(1.5));
}

TEST_CASE("a seek before the first step of a growing recording sets the position") {
  Machine m(true);
  REQUIRE(m.playback.follow_state() == FollowState::kJoining);
  REQUIRE(m.playback.seek(0.5).ok());
  m.step(0.01);
  CHECK(m.playback.seconds() == Approx(0.5));
}

TEST_CASE("a loop takes effect once the recording is closed") {
  Machine m = recording_in(FollowState::kFollowing, true);
  m.playback.set_loop(true);
  CHECK_FALSE(m.playback.take_effects().playhead->loop);
  m.data.file.growing = false;
  m.data.file.file_bytes += 1;
  std::string events = m.step(0.01);
  CHECK(m.effects.playhead->loop);
  for (int k = 0; k < 10; ++k) events += m.step(0.1);
  CHECK(events == "FL");
}

TEST_CASE("effects report the position of each event, and a new playhead only if it may differ") {
  Machine m = clip_in(PlayState::kPlaying);
  const double before = m.playback.seconds();
  CHECK(m.step(0.01, false) == "B");
  CHECK(m.effects.events[0].seconds == before);
  CHECK(m.effects.playhead->stationary);
  CHECK_FALSE(m.effects.jumped);
  CHECK(m.step(0.01, false) == "");
  CHECK_FALSE(m.effects.playhead);
  REQUIRE(m.playback.seek_frame(3).ok());
  m.events();
  CHECK(m.effects.jumped);
  CHECK(m.effects.playhead->ticks == 3);
}

TEST_CASE("a copy of the state machine continues independently") {
  Machine m = clip_in(PlayState::kPlaying);
  Playback copy = m.playback;
  copy.pause();
  CHECK(copy.state() == PlayerState::kPaused);
  CHECK(m.playback.state() == PlayerState::kPlaying);
}

}  // namespace
}  // namespace stgs::player
