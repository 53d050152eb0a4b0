// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <set>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "stgs/format/math/blend.h"
#include "stgs/format/math/lifespan.h"

using namespace stgs;
using stgs::testing::fingerprints;
using stgs::testing::random_scene;

namespace {

// Lifespans of every length, some reaching past the clip, some never visible.
Scene random_lifespans(std::uint32_t frames, unsigned seed) {
  Scene scene = random_scene(2000, 0, frames, seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  const auto clip = static_cast<float>(frames);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = clip * (1.4f * uniform(random) - 0.2f);
    set.sigma[i] = std::exp(std::log(3.0f * clip) * uniform(random)) * 0.1f;
    set.radius[i] = uniform(random) < 0.5f ? 0.0f : 0.5f * clip * uniform(random) * uniform(random);
    set.opacity_logit[i] = 14.0f * uniform(random) - 8.0f;
  }
  return scene;
}

std::unique_ptr<SceneReader> write_and_open(const Scene& scene, const WriteSettings& settings) {
  auto bytes = encode_scene(scene, settings);
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  return std::move(*reader);
}

bool visible(const Gaussians4D& set, std::size_t i, float t) {
  const float opacity = math::opacity_of(set.opacity_logit[i]);
  return opacity * math::visibility(t - set.time[i], set.sigma[i], set.radius[i]) >=
         math::kAlphaThreshold;
}

}  // namespace

TEST_CASE("every visible primitive is in a segment active at that time") {
  for (Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    for (std::uint32_t frames : {1u, 17u, 300u}) {
      WriteSettings settings;
      settings.profile = profile;
      const auto reader = write_and_open(random_lifespans(frames, frames), settings);
      std::vector<Gaussians4D> sets;
      for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
        auto set = reader->decode(s);
        REQUIRE(set.ok());
        sets.push_back(std::move(*set));
      }
      std::mt19937 random(frames);
      std::uniform_real_distribution<float> uniform_time(0.0f, static_cast<float>(frames));
      std::size_t missed = 0, visible_count = 0;
      for (int trial = 0; trial < 60; ++trial) {
        const float t = trial == 0   ? 0.0f
                        : trial == 1 ? static_cast<float>(frames)
                        : trial < 20 ? std::floor(uniform_time(random))
                                     : uniform_time(random);
        const auto found = reader->segments_between(t, t);
        std::map<std::pair<int, int>, int> segments_of_tier;  // by level
        for (std::uint32_t s : found) {
          ++segments_of_tier[{reader->segments()[s].level, reader->segments()[s].tier}];
        }
        for (const auto& [key, count] : segments_of_tier) CHECK(count <= (key.first < 0 ? 1 : 2));
        for (std::uint32_t s = 0; s < sets.size(); ++s) {
          const bool listed = std::find(found.begin(), found.end(), s) != found.end();
          for (std::size_t i = 0; i < sets[s].size(); ++i) {
            if (!visible(sets[s], i, t)) continue;
            ++visible_count;
            missed += listed ? 0 : 1;
          }
        }
      }
      CHECK(visible_count > 1000);
      CHECK(missed == 0);
    }
  }
}

TEST_CASE("every primitive is stored once, never visible ones only in the lossless profile") {
  const Scene scene = random_lifespans(120, 5);
  const auto lossless = write_and_open(scene, {});
  CHECK(lossless->primitives() == scene.gaussians.size());
  std::multiset<std::string> stored;
  for (std::uint32_t s = 0; s < lossless->segments().size(); ++s) {
    for (std::string& print : fingerprints(*lossless->decode(s))) stored.insert(std::move(print));
  }
  const auto expected = fingerprints(scene.gaussians);
  CHECK(stored == std::multiset<std::string>(expected.begin(), expected.end()));

  std::size_t ever_visible = 0;
  for (std::size_t i = 0; i < scene.gaussians.size(); ++i) {
    bool shown = false;
    for (float t = 0.0f; t <= 120.0f && !shown; t += 0.125f) shown = visible(scene.gaussians, i, t);
    ever_visible += shown ? 1 : 0;
  }
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  std::vector<std::uint32_t> order;
  REQUIRE(encode_scene(scene, settings, &order).ok());
  CHECK(order.size() < scene.gaussians.size());
  CHECK(order.size() >= ever_visible * 95 / 100);  // rounding may hide barely visible primitives
  CHECK(std::set<std::uint32_t>(order.begin(), order.end()).size() == order.size());
}

TEST_CASE("a lossless segment has one tier, and packing separates primitives that never change") {
  Scene scene = random_scene(3000, 1, 60, 4);
  Gaussians4D& set = scene.gaussians;
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = 30.0f;
    set.sigma[i] = 1.0f;
    set.radius[i] = 60.0f;
    set.opacity_logit[i] = 2.0f;
    for (std::size_t c = 0; c < 3; ++c) set.velocity[3 * i + c] = i % 2 == 0 ? 0.0f : 0.05f;
  }
  WriteSettings settings;
  CHECK(write_and_open(scene, settings)->segments().size() == 1);
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  const auto reader = write_and_open(scene, settings);
  REQUIRE(reader->segments().size() == 2);
  const auto static_segment = reader->decode(0), dynamic_segment = reader->decode(1);
  REQUIRE(static_segment.ok());
  REQUIRE(dynamic_segment.ok());
  CHECK(std::all_of(static_segment->velocity.begin(), static_segment->velocity.end(),
                    [](float u) { return u == 0.0f; }));
  CHECK(dynamic_segment->size() == 1500);
  CHECK(std::none_of(dynamic_segment->velocity.begin(), dynamic_segment->velocity.end(),
                     [](float u) { return u == 0.0f; }));
}

TEST_CASE("segments are stored by begin time, the longer first") {
  WriteSettings settings;
  settings.chunk_seconds = 0.5;
  const auto reader = write_and_open(random_lifespans(300, 8), settings);
  const auto& segments = reader->segments();
  REQUIRE(segments.size() > 20);
  CHECK(segments[0].level == -1);
  for (std::size_t i = 1; i < segments.size(); ++i) {
    CHECK(segments[i].offset == segments[i - 1].offset + segments[i - 1].bytes);
    const bool later = segments[i].begin_ticks > segments[i - 1].begin_ticks;
    const bool longer_first = segments[i].begin_ticks == segments[i - 1].begin_ticks &&
                              segments[i].end_ticks <= segments[i - 1].end_ticks;
    CHECK((later || longer_first));
  }
  // Only COPY follows: a record header, the head and its length.
  CHECK(segments.back().offset + segments.back().bytes ==
        reader->file_bytes() - (24 + reader->head_bytes() + 8));
}

TEST_CASE("a segment is at most four times as long as its lifespans, or one chunk") {
  Scene scene = random_lifespans(600, 9);
  WriteSettings settings;
  settings.chunk_seconds = 0.5;
  const auto reader = write_and_open(scene, settings);
  for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
    const SegmentInfo& segment = reader->segments()[s];
    if (segment.level <= 0) continue;
    const auto set = reader->decode(s);
    REQUIRE(set.ok());
    const double span = 15.0 * (1 << segment.level);
    for (std::size_t i = 0; i < set->size(); ++i) {
      const double half =
          math::support_half_width(math::opacity_of(set->opacity_logit[i]), set->sigma[i],
                                   set->radius[i], math::kAlphaThreshold);
      const double begin = std::max(0.0, set->time[i] - half);
      const double end = std::min(600.0, set->time[i] + half);
      CHECK(span <= 4.0 * (end - begin) + 0.1);
    }
  }
}

TEST_CASE("the segments of an interval are those of all times in it") {
  WriteSettings settings;
  settings.chunk_seconds = 0.5;
  const auto reader = write_and_open(random_lifespans(300, 10), settings);
  std::set<std::uint32_t> expected;
  for (double t = 40.0; t <= 55.0; t += 0.25) {
    for (std::uint32_t s : reader->segments_between(t, t)) expected.insert(s);
  }
  const auto found = reader->segments_between(40.0, 55.0);
  CHECK(std::set<std::uint32_t>(found.begin(), found.end()) == expected);
  CHECK(found.size() < reader->segments().size());
  CHECK(std::is_sorted(found.begin(), found.end()));
  CHECK(reader->segments_between(5.0, 4.0).empty());
  CHECK(reader->segments_between(NAN, 4.0).empty());
  CHECK(reader->segments_between(-10.0, 1e9).size() == reader->segments().size());
}
