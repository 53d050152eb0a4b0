// SPDX-License-Identifier: Apache-2.0
// The observable state transitions of a player: one table for clips, one for growing recordings.
#include <string>

#include "catch.h"
#include "live_fixture.h"
#include "stream_fixture.h"

namespace stgs::player {
namespace {

// The situation of a player before an input.
enum class From { kPaused, kStarting, kStalled, kPausedInStall, kPlaying, kEnded };
enum class Input { kPlay, kPause, kSeek, kAdvanceWithoutData, kAdvanceWithData };

struct Transition {
  From from;
  Input input;
  PlayerState state;
  int buffering = 0, resumed = 0;  // events of this input
};

// A player whose link delivers nothing but the segments that the situation needs.
struct Situation : TestPlayer {
  explicit Situation(From from) : TestPlayer(settings(), clip().bytes, block) {
    if (from == From::kPaused) return;
    if (from == From::kPlaying || from == From::kEnded) {
      REQUIRE(player->seek_frame(from == From::kEnded ? 87 : 10).ok());
      fetch();
      block(*link);
    }
    player->play();
    if (from != From::kStarting) advance();
    if (from == From::kPausedInStall) player->pause();
    if (from == From::kEnded) play_to_end();
    events.clear();
  }

  static PlayerSettings settings() {
    PlayerSettings settings;
    settings.prefetch_seconds = 0.3;
    settings.resume_seconds = 0.15;  // more than an advance() moves
    return settings;
  }
  static void block(Link& link) { link.set(Link::Answer::kWait, clip().segments_begin); }

  // Waits until the data at the position has arrived, without advancing.
  void fetch() {
    link->set(Link::Answer::kBytes);
    for (int k = 0; k < 4000; ++k) {
      const double at = player->seconds(), to = std::min(at + 0.2, 3.0);
      const auto ranges = player->buffered();
      const bool covered = std::any_of(ranges.begin(), ranges.end(), [&](const TimeRange& range) {
        return range.begin <= at && to <= range.end;
      });
      if (covered && player->layers() == player->layer_count()) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    FAIL("the data did not arrive");
  }
  void advance() {
    player->advance(now);
    for (PlayerEvent& event : player->take_events()) events.push_back(std::move(event));
  }
  void apply(Input input) {
    switch (input) {
      case Input::kPlay:
        return player->play();
      case Input::kPause:
        return player->pause();
      case Input::kSeek: {
        REQUIRE(player->seek_frame(45).ok());
        return;
      }
      case Input::kAdvanceWithData:
        fetch();
        return advance();
      case Input::kAdvanceWithoutData:
        for (int k = 0; k < 20; ++k, now += 0.1) advance();
    }
  }
};

constexpr Transition kTransitions[] = {
    {From::kPaused, Input::kPlay, PlayerState::kBuffering},
    {From::kPaused, Input::kPause, PlayerState::kPaused},
    {From::kPaused, Input::kSeek, PlayerState::kPaused},
    {From::kPaused, Input::kAdvanceWithoutData, PlayerState::kPaused},
    {From::kPaused, Input::kAdvanceWithData, PlayerState::kPaused},
    {From::kStarting, Input::kPlay, PlayerState::kBuffering},
    {From::kStarting, Input::kPause, PlayerState::kPaused},
    {From::kStarting, Input::kSeek, PlayerState::kBuffering},
    {From::kStarting, Input::kAdvanceWithoutData, PlayerState::kBuffering, 1, 0},
    {From::kStarting, Input::kAdvanceWithData, PlayerState::kPlaying},
    {From::kStalled, Input::kPlay, PlayerState::kBuffering},
    {From::kStalled, Input::kPause, PlayerState::kPaused},
    {From::kStalled, Input::kSeek, PlayerState::kBuffering},
    {From::kStalled, Input::kAdvanceWithoutData, PlayerState::kBuffering},
    {From::kStalled, Input::kAdvanceWithData, PlayerState::kPlaying, 0, 1},
    {From::kPausedInStall, Input::kPlay, PlayerState::kBuffering},
    {From::kPausedInStall, Input::kPause, PlayerState::kPaused},
    {From::kPausedInStall, Input::kSeek, PlayerState::kPaused},
    {From::kPausedInStall, Input::kAdvanceWithoutData, PlayerState::kPaused},
    {From::kPausedInStall, Input::kAdvanceWithData, PlayerState::kPaused},
    {From::kPlaying, Input::kPlay, PlayerState::kPlaying},
    {From::kPlaying, Input::kPause, PlayerState::kPaused},
    {From::kPlaying, Input::kSeek, PlayerState::kBuffering},
    {From::kPlaying, Input::kAdvanceWithoutData, PlayerState::kBuffering, 1, 0},
    {From::kPlaying, Input::kAdvanceWithData, PlayerState::kPlaying},
    {From::kEnded, Input::kPlay, PlayerState::kBuffering},
    {From::kEnded, Input::kPause, PlayerState::kPaused},
    {From::kEnded, Input::kSeek, PlayerState::kPaused},
    {From::kEnded, Input::kAdvanceWithoutData, PlayerState::kEnded},
    {From::kEnded, Input::kAdvanceWithData, PlayerState::kEnded},
};

TEST_CASE("a clip's player changes its state and reports stalls as listed") {
  for (const Transition& expected : kTransitions) {
    CAPTURE(static_cast<int>(expected.from), static_cast<int>(expected.input));
    Situation p(expected.from);
    p.apply(expected.input);
    CHECK(p.player->state() == expected.state);
    CHECK(p.count(Kind::kBuffering) == expected.buffering);
    CHECK(p.count(Kind::kResumed) == expected.resumed);
    CHECK(p.count(Kind::kEnded) == 0);
  }
}

TEST_CASE("a stall that a pause interrupts is reported once and ends with one event") {
  Situation p(From::kPausedInStall);
  p.player->play();
  p.advance();
  CHECK(p.count(Kind::kBuffering) == 0);
  p.fetch();
  p.advance();
  CHECK(p.player->state() == PlayerState::kPlaying);
  CHECK(p.count(Kind::kResumed) == 1);
}

TEST_CASE("playback that starts at the end continues from the other end") {
  Situation forward(From::kEnded);
  CHECK(forward.player->seconds() == 89.0 / 30);
  forward.player->play();
  CHECK(forward.player->seconds() == 0);
  Situation backward(From::kPaused);
  REQUIRE(backward.player->set_rate(-1).ok());
  backward.player->play();
  CHECK(backward.player->seconds() == 89.0 / 30);
}

// Whether a player of a growing recording follows its edge, after each input.
TEST_CASE("a growing recording is followed until the position or the rate is set") {
  using live::Viewer;
  struct Step {
    std::string name;
    void (*apply)(Player&);
    bool following_paused, following_playing;
  };
  const Step steps[] = {
      {"none", [](Player&) {}, true, true},
      {"play", [](Player& p) { p.play(); }, true, true},
      {"pause", [](Player& p) { p.pause(); }, true, false},
      {"seek to a frame", [](Player& p) { (void)p.seek_frame(7); }, false, false},
      {"seek", [](Player& p) { (void)p.seek(0.5); }, false, false},
      {"seek past the edge", [](Player& p) { (void)p.seek(1e6); }, true, true},
      {"rate 1", [](Player& p) { (void)p.set_rate(1); }, true, true},
      {"rate -1", [](Player& p) { (void)p.set_rate(-1); }, false, false},
      {"go live", [](Player& p) { p.go_live(); }, true, true},
      {"seek, then go live",
       [](Player& p) {
         (void)p.seek_frame(7);
         p.go_live();
       },
       true, true},
  };
  for (const Step& input : steps) {
    CAPTURE(input.name);
    Viewer paused(6);
    paused.tick();
    input.apply(*paused.player);
    paused.tick();
    CHECK(paused.player->live().following == input.following_paused);
    Viewer playing(6);
    playing.play();
    input.apply(*playing.player);
    playing.tick();
    CHECK(playing.player->live().following == input.following_playing);
  }
}

TEST_CASE("playback that starts while it follows a recording starts at the edge") {
  live::Viewer viewer(6);
  viewer.tick();
  viewer.player->pause();
  viewer.file->grow(live::recording().ends[12]);
  REQUIRE(viewer.wait_for_edge(12));
  const double before = viewer.player->seconds();
  viewer.player->play();
  viewer.tick();
  CHECK(viewer.player->seconds() > before + live::kFragmentSeconds);
}

}  // namespace
}  // namespace stgs::player
