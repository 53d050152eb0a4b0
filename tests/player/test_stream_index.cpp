// SPDX-License-Identifier: Apache-2.0
// A player reads the index of a long file as playback needs it.
#include "stream_fixture.h"

using namespace stgs;
using namespace stgs::player;

namespace {

constexpr std::uint32_t kLong = 20000;  // frames

// A file whose index takes several nodes.
const std::vector<std::uint8_t>& long_file() {
  static const std::vector<std::uint8_t> bytes = [] {
    Scene scene = stgs::testing::random_scene(12000, 0, kLong, 5);
    std::mt19937 random(6);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
      scene.gaussians.time[i] = static_cast<float>(kLong) * uniform(random);
      scene.gaussians.sigma[i] = 0.5f;
      scene.gaussians.radius[i] = 0;
      scene.gaussians.opacity_logit[i] = 3;
    }
    WriteSettings settings;
    settings.chunk_seconds = 0.2;
    auto encoded = encode_scene(scene, settings);
    REQUIRE(encoded.ok());
    return std::move(*encoded);
  }();
  return bytes;
}

std::multiset<std::string> active_in_long_file(double seconds) {
  auto reader = SceneReader::open(memory_source(long_file()));
  REQUIRE(reader.ok());
  return active_fingerprints(*Timeline::from_reader(std::move(*reader)), seconds);
}

std::size_t known_segments(const TestPlayer& test) {
  REQUIRE(test.player->timeline().at(test.player->seconds()).ok());
  return test.player->timeline().reader().segments().size();
}

// Seeks, waits until everything is there, and compares the active primitives with the file.
void check_at(TestPlayer& test, double seconds) {
  REQUIRE(test.player->seek(seconds).ok());
  REQUIRE(test.wait_until([&] { return test.player->is_complete(); }));
  const double at = test.player->seconds();
  CHECK(active_fingerprints(test.player->timeline(), at) == active_in_long_file(at));
}

}  // namespace

TEST_CASE("a player knows the segments around its position, and those of a seek") {
  const auto complete = SceneReader::open(memory_source(long_file()));
  REQUIRE(complete.ok());
  const std::size_t all = (*complete)->segments().size();
  TestPlayer test({}, long_file());
  CHECK(test.player->timeline().reader().head_bytes() <= 16384);
  for (const double seconds : {0.0, 400.0, 600.0, 100.0, 401.0}) check_at(test, seconds);
  CHECK(known_segments(test) < all);
  CHECK(known_segments(test) > all / 8);
  CHECK(test.events.end() ==
        std::find_if(test.events.begin(), test.events.end(), [](const auto& e) {
          return e.kind == Kind::kReadFailed || e.kind == Kind::kDamaged;
        }));
  // Times whose segments are not known are not buffered.
  for (const TimeRange& range : test.player->buffered()) CHECK(range.end - range.begin < 500);
}

TEST_CASE("playback continues over the nodes of an index") {
  TestPlayer test({}, long_file());
  REQUIRE(test.player->seek(80).ok());
  REQUIRE(test.player->set_rate(4).ok());
  test.player->play();
  const std::size_t before = known_segments(test);
  REQUIRE(test.wait_until([&] {
    test.now += test.player->state() == PlayerState::kPlaying ? 0.2 : 0.0;
    return test.player->seconds() > 160;
  }));
  test.player->pause();
  REQUIRE(test.wait_until([&] { return test.player->is_complete(); }));
  CHECK(known_segments(test) > before);
  const double at = test.player->seconds();
  CHECK(active_fingerprints(test.player->timeline(), at) == active_in_long_file(at));
}

TEST_CASE("a part of the index that cannot be read is reported once, and read later") {
  PlayerSettings settings;
  settings.retry_seconds = 0.02;
  TestPlayer test(settings, long_file());
  check_at(test, 0);
  test.link->set(Link::Answer::kFail);
  REQUIRE(test.player->seek(500).ok());
  // Events of segments have another offset.
  const auto failures = [&test] {
    return std::count_if(test.events.begin(), test.events.end(), [](const PlayerEvent& e) {
      return e.kind == Kind::kReadFailed && e.offset == 0;
    });
  };
  REQUIRE(test.wait_until([&] { return failures() > 0; }));
  CHECK_FALSE(test.player->is_complete());
  const auto later = Clock::now() + std::chrono::milliseconds(200);
  REQUIRE(test.wait_until([&] { return Clock::now() > later; }));
  CHECK(failures() == 1);
  test.link->set(Link::Answer::kBytes);
  const auto expected = active_in_long_file(500);
  CHECK(test.wait_until(
      [&] { return active_fingerprints(test.player->timeline(), 500) == expected; }));
}
