// SPDX-License-Identifier: Apache-2.0
// Files of scenes in parts, and of windows of a capture (spec 4.5, 5.3).
#include <set>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "head_fixture.h"

using namespace stgs;
using stgs::testing::file_of;
using stgs::testing::random_scene;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::uint32_t kFrames = 40;
const std::vector<ScenePart> kParts = {{0, 13.5, 700}, {25, 40, 500}};

Scene scene_in_parts() {
  Scene scene = random_scene(1200, 1, kFrames, 3);
  scene.parts = kParts;
  scene.metadata.window = CaptureWindow{100, 500, 0x1234567890, 77};
  return scene;
}

std::unique_ptr<SceneReader> reader_of(const Scene& scene, Profile profile) {
  WriteSettings settings;
  settings.profile = profile;
  settings.chunk_seconds = 0.1;
  auto bytes = encode_scene(scene, settings);
  INFO(bytes.status().message());
  REQUIRE(bytes.ok());
  const auto issues = validate_scene(*memory_source(*bytes));
  REQUIRE(issues.ok());
  for (const Issue& issue : *issues) UNSCOPED_INFO(issue.message);
  CHECK(issues->empty());
  auto reader = SceneReader::open(memory_source(std::move(*bytes)));
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  return std::move(*reader);
}

Bytes metadata_record() {
  FileMetadata metadata;
  metadata.scene.frames = kFrames;
  return write_record(kMetadataTag, write_metadata(metadata));
}

Bytes index_record() {
  return write_record(kIndexTag, write_index({}, {}));
}

std::set<int> issues_of(const Bytes& bytes) {
  const auto issues = validate_scene(*memory_source(bytes));
  REQUIRE(issues.ok());
  std::set<int> numbers;
  for (const Issue& issue : *issues) numbers.insert(issue.number);
  return numbers;
}

}  // namespace

TEST_CASE("a file preserves the primitives, parts and window of a scene") {
  const Scene scene = scene_in_parts();
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const auto reader = reader_of(scene, profile);
    CHECK(reader->metadata().window == scene.metadata.window);
    REQUIRE(reader->parts().size() == 2);
    for (std::size_t p = 0; p < 2; ++p) {
      CHECK(reader->parts()[p].begin_ticks == kParts[p].begin_ticks);
      CHECK(reader->parts()[p].end_ticks == kParts[p].end_ticks);
    }
    if (profile == Profile::kLossless) CHECK(reader->parts() == kParts);
    for (const SegmentInfo& segment : reader->segments()) {
      const ScenePart& part = reader->parts()[segment.part];
      CHECK(segment.begin_ticks >= part.begin_ticks);
      CHECK(segment.end_ticks <= part.end_ticks);
    }
  }
  WriteSettings settings;
  const auto bytes = encode_scene(scene, settings);
  const auto read = read_scene(memory_source(*bytes));
  REQUIRE(read.ok());
  CHECK(read->parts == kParts);
  // Each part has its own primitives, in any order.
  std::uint32_t first = 0;
  for (const ScenePart& part : kParts) {
    std::vector<std::uint32_t> members(part.primitives);
    for (std::uint32_t& i : members) i = first++;
    auto expected = testing::fingerprints(scene.gaussians.gather(members));
    auto found = testing::fingerprints(read->gaussians.gather(members));
    std::sort(expected.begin(), expected.end());
    std::sort(found.begin(), found.end());
    CHECK(expected == found);
  }
}

TEST_CASE("the segments at a time are those of one part") {
  const auto reader = reader_of(scene_in_parts(), Profile::kQuantised);
  const auto parts_at = [&](double t) {
    std::set<std::uint32_t> parts;
    for (const std::uint32_t s : reader->segments_between(t, t)) {
      parts.insert(reader->segments()[s].part);
    }
    return parts;
  };
  const std::set<std::uint32_t> first = {0}, last = {1};
  CHECK(parts_at(-5) == first);
  CHECK(parts_at(0) == first);
  CHECK(parts_at(13.49999) == first);
  CHECK(parts_at(13.5).empty());
  CHECK(parts_at(24.99999).empty());
  CHECK(parts_at(25) == last);
  CHECK(parts_at(kFrames) == last);
  CHECK(parts_at(1e6) == last);
}

TEST_CASE("a segment is needed at the end of its interval while its part is displayed") {
  constexpr double kPartEnd = 30, kFrom = 9;  // chunks of 3 ticks end at both
  Scene scene = random_scene(1200, 1, kFrames, 3);
  scene.parts = {{0, kPartEnd, 1200, TickRange{kFrom, kPartEnd}}};
  const auto reader = reader_of(scene, Profile::kQuantised);
  const auto is_needed = [&](std::uint32_t segment, double t) {
    const std::vector<std::uint32_t> all = reader->segments_between(t, t);
    return std::binary_search(all.begin(), all.end(), segment);
  };
  int inner = 0, at_part_end = 0, at_one_time = 0;
  for (std::uint32_t s = 0; s < reader->segments().size(); ++s) {
    const SegmentInfo& segment = reader->segments()[s];
    if (!segment.is_needed()) continue;
    const bool inside = segment.end_ticks < kPartEnd;
    CHECK(segment.needed_at_end == inside);
    CHECK(is_needed(s, segment.begin_ticks));
    CHECK(is_needed(s, segment.end_ticks) == inside);
    CHECK_FALSE(is_needed(s, segment.end_ticks + 1e-6));
    CHECK_FALSE(is_needed(s, segment.begin_ticks - 1e-6));
    (inside ? inner : at_part_end) += 1;
    if (segment.begin_ticks < segment.end_ticks) continue;
    CHECK(segment.begin_ticks == kFrom);
    ++at_one_time;
  }
  CHECK(inner > 5);
  CHECK(at_part_end > 0);
  CHECK(at_one_time > 0);
}

TEST_CASE("a scene without parts has one part, the complete timeline") {
  Scene scene = random_scene(50, 0, kFrames, 3);
  const std::vector<ScenePart> timeline = {{0, kFrames, 50}};
  CHECK(reader_of(scene, Profile::kLossless)->parts() == timeline);
  scene.parts = timeline;
  CHECK(reader_of(scene, Profile::kLossless)->parts() == timeline);
}

TEST_CASE("parts are cut and moved by editing the index alone") {
  const Scene scene = scene_in_parts();
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    settings.chunk_seconds = 0.1;
    const auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    // Remove the first ten frames, and the gap between the first and the last part.
    FileHead head = testing::head_of(*bytes);
    for (PartEntry& part : head.parts) {
      const double shift = part.begin == 25 ? 21.5 : 10;
      part.begin -= shift;
      part.end -= shift;
    }
    head.parts[0].displayed = {0, 3.25};
    head.parts[1].displayed = {3.5, 18.5};
    const Bytes edited = testing::with_index(*bytes, head);
    const auto issues = validate_scene(*memory_source(edited));
    REQUIRE(issues.ok());
    CHECK(issues->empty());
    const auto before = read_scene(memory_source(*bytes)),
               after = read_scene(memory_source(edited));
    REQUIRE(after.ok());
    CHECK(after->gaussians.position == before->gaussians.position);
    CHECK(after->gaussians.time == before->gaussians.time);
    CHECK(after->gaussians.velocity == before->gaussians.velocity);
    CHECK(after->parts[0].begin_ticks == -10);
    CHECK(after->parts[0].displayed_range() == TickRange{0, 3.25});
    const auto reader = SceneReader::open(memory_source(edited));
    const auto parts_at = [&](double t) {
      std::set<std::uint32_t> parts;
      for (const std::uint32_t s : (*reader)->segments_between(t, t)) {
        parts.insert((*reader)->segments()[s].part);
      }
      return parts;
    };
    CHECK(parts_at(0) == std::set<std::uint32_t>{0});
    CHECK(parts_at(3.2) == std::set<std::uint32_t>{0});
    CHECK(parts_at(3.25).empty());
    CHECK(parts_at(3.5) == std::set<std::uint32_t>{1});
    // Writing the scene again preserves the parts.
    Scene again = *after;
    const auto written = encode_scene(again, {});
    REQUIRE(written.ok());
    CHECK(read_scene(memory_source(*written))->parts == after->parts);
  }
}

TEST_CASE("invalid parts and windows are not written") {
  Scene scene = random_scene(50, 0, kFrames, 3);
  for (const std::vector<ScenePart>& parts :
       std::vector<std::vector<ScenePart>>{{{0, 20, 25}, {20, 40, 24}},
                                           {{0, 40.0000001, 50}},
                                           {{0, 40, 50, TickRange{-1, 40}}},
                                           {{0, 40, 50, TickRange{3, 3}}},
                                           {{5, 5, 50}},
                                           {{NAN, 40, 50}}}) {
    scene.parts = parts;
    CHECK(encode_scene(scene, {}).status().code() == StatusCode::kUsage);
  }
  scene.parts.clear();
  scene.metadata.window = CaptureWindow{10, 49, 0, 0};
  CHECK(encode_scene(scene, {}).status().code() == StatusCode::kUsage);
}

TEST_CASE("invalid window records are reported by number and ignored") {
  const Bytes meta = metadata_record(), index = index_record();
  const auto window = [](const CaptureWindow& w, std::uint32_t flags = 0) {
    return write_record(kWindowTag, write_window(w), flags);
  };
  CHECK(issues_of(file_of({meta, window({0, 40, 1, 1}), index})).empty());
  CHECK(issues_of(file_of({window({60, 100, 1, 1}), meta, index})).empty());
  const auto is_ignored = [](const Bytes& bytes, int number) {
    CHECK(issues_of(bytes) == std::set<int>{number});
    const auto reader = SceneReader::open(memory_source(bytes));
    REQUIRE(reader.ok());
    CHECK((*reader)->damage().size() == 1);
    return !(*reader)->metadata().window;
  };
  CHECK(is_ignored(file_of({meta, window({61, 100, 1, 1}), index}), 206));
  CHECK(is_ignored(file_of({meta, write_record(kWindowTag, Bytes(23), 0), index}), 206));
  Bytes flipped = window({0, 40, 1, 1});
  flipped.back() ^= 1;
  CHECK(is_ignored(file_of({meta, flipped, index}), 112));
  CHECK_FALSE(
      is_ignored(file_of({meta, window({0, 40, 1, 1}), window({0, 50, 1, 1}), index}), 114));
  CHECK(issues_of(file_of({meta, window({0, 40, 1, 1}, kCritical), index})).count(113) == 1);
}
