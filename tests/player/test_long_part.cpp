// SPDX-License-Identifier: Apache-2.0
// Times far into a long part, which single precision cannot state (spec 8.9).
#include <algorithm>
#include <cmath>
#include <thread>

#include "catch.h"
#include "fixtures/long_part.h"
#include "stgs/format/scene_file.h"
#include "stgs/player/player.h"
#include "stgs/player/renderer.h"

namespace stgs::player {
namespace {

const testing::FarContent& content() {
  static const testing::FarContent made = testing::make_far_content(2000);
  return made;
}

std::unique_ptr<SceneReader> reader_of(const std::vector<std::uint8_t>& bytes) {
  auto reader = SceneReader::open(memory_source(bytes));
  REQUIRE(reader.ok());
  return std::move(*reader);
}

View make_view() {
  View view{};
  view.camera =
      math::PinholeCamera{{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}, 90, 90, 50, 40, 100, 80, 0.1f};
  view.background = {0.2f, 0.5f, 0.7f};
  return view;
}

std::vector<float> colours(Renderer& renderer, Timeline& timeline, double seconds) {
  std::vector<Frame> frames;
  const Status status = renderer.render(timeline, seconds, {make_view()}, frames, nullptr);
  INFO(status.message());
  REQUIRE(status.ok());
  return frames[0].colour.data;
}

float greatest_difference(const std::vector<float>& a, const std::vector<float>& b) {
  REQUIRE(a.size() == b.size());
  float greatest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) greatest = std::max(greatest, std::abs(a[i] - b[i]));
  return greatest;
}

TEST_CASE("decoded times that count from their record are exact in a long part") {
  const auto near = reader_of(content().near), far = reader_of(content().far);
  REQUIRE(near->segments().size() == far->segments().size());
  REQUIRE(content().shift > 0x1p29);
  std::size_t fractions = 0;
  double rounding = 0;
  for (std::uint32_t s = 0; s < far->segments().size(); ++s) {
    CHECK(near->render_origin(s) == TimeOrigin::kPart);
    CHECK(far->render_origin(s) == TimeOrigin::kRecord);
    const auto expected = near->decode(s, true, TimeOrigin::kRecord);
    const auto found = far->decode(s, true, TimeOrigin::kRecord);
    const auto from_part = far->decode(s, true);
    REQUIRE((expected.ok() && found.ok() && from_part.ok()));
    CHECK(from_part->time_origin == 0);
    CHECK(found->time_origin == expected->time_origin + content().shift);
    CHECK(found->time == expected->time);
    CHECK(found->velocity == expected->velocity);
    for (std::size_t i = 0; i < found->size(); ++i) {
      const double time = found->time_origin + found->time[i];
      fractions += time != std::floor(time) ? 1 : 0;
      rounding = std::max(rounding, std::abs(time - from_part->time[i]));
    }
  }
  CHECK(fractions > 1000);
  CHECK(rounding > 10);  // ticks
}

TEST_CASE("times in a part of up to 2^14 ticks count from its beginning, as before") {
  const auto near = reader_of(content().near);
  auto timeline = Timeline::from_reader(reader_of(content().near));
  const auto active = timeline->at(110);
  REQUIRE(active.ok());
  REQUIRE_FALSE(active->segments.empty());
  for (const auto& one : active->segments) {
    CHECK(one.ticks == 110);
    CHECK(one.set->time_origin == 0);
    CHECK(one.set->time == near->decode(one.segment, true)->time);
  }
}

TEST_CASE("a timeline of a long part renders its content as that of a short one") {
  const auto renderer = std::move(*make_renderer("cpu"));
  const auto near = Timeline::from_reader(reader_of(content().near));
  const auto far = Timeline::from_reader(reader_of(content().far));
  const auto background = colours(*renderer, *near, 400);
  for (const double ticks : {96.0, 103.6328125, 112.0, 119.001, 128.0}) {
    const auto expected = colours(*renderer, *near, ticks);
    CHECK(greatest_difference(expected, background) > 0.1f);
    CHECK(greatest_difference(expected, colours(*renderer, *far, ticks + content().shift)) <=
          1e-3f);
  }
}

TEST_CASE("a player seeks far into a long part and plays across its segments") {
  const auto renderer = std::move(*make_renderer("cpu"));
  const auto near = Timeline::from_reader(reader_of(content().near));
  auto opened = Player::from_source(memory_source(content().far), {});
  REQUIRE(opened.ok());
  Player& player = **opened;
  double now = 100;
  const auto wait_for_frame = [&] {
    for (int k = 0; k < 4000; ++k) {
      player.advance(now);
      if (player.layers() == player.layer_count()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  };
  REQUIRE(wait_for_frame());
  REQUIRE(player.seek(content().shift + 95.25).ok());
  player.play();
  REQUIRE(wait_for_frame());
  double last = 0;
  for (int step = 0; step < 80; ++step) {
    now += kMaxStepSeconds;
    REQUIRE(wait_for_frame());
    last = player.seconds() - content().shift;
    const auto expected = colours(*renderer, *near, last);
    CHECK(greatest_difference(expected, colours(*renderer, player.timeline(), player.seconds())) <=
          1e-3f);
  }
  CHECK(last > 110);  // several segments of 16 ticks later
}

TEST_CASE("a long part is valid, but is not loaded as a whole") {
  const auto issues = validate_scene(*memory_source(content().far));
  REQUIRE(issues.ok());
  for (const Issue& issue : *issues) FAIL_CHECK(issue.message);
  REQUIRE(read_scene(memory_source(content().near)).ok());
  const auto scene = read_scene(memory_source(content().far));
  CHECK(scene.status().code() == StatusCode::kUnsupported);
  CHECK(scene.status().message().find("cannot be loaded as a whole") != std::string::npos);
}

}  // namespace
}  // namespace stgs::player
