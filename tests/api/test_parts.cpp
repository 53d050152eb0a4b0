// SPDX-License-Identifier: Apache-2.0
// Scenes in parts, and windows of a capture, in a file (spec 4.5, 5.10).
#include <catch2/catch.hpp>
#include <set>

#include "container.h"
#include "scene_fixture.h"

using namespace stgs;
using stgs::testing::random_scene;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::uint32_t kFrames = 40;
const std::vector<ScenePart> kParts = {{0, 13.5, 700}, {13.5, 25, 0}, {25, 40, 500}};

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

// A file of one head record after another; no segments.
Bytes file_of(const std::vector<Bytes>& records) {
  FileHeader header;
  header.head_bytes = kHeaderBytes;
  for (const Bytes& record : records) header.head_bytes += record.size();
  header.file_bytes = header.head_bytes;
  Bytes file = write_header(header);
  for (const Bytes& record : records) file.insert(file.end(), record.begin(), record.end());
  return file;
}

Bytes metadata_record() {
  FileMetadata metadata;
  metadata.scene.frames = kFrames;
  return write_record(kMetadataTag, write_metadata(metadata));
}

Bytes index_record() {
  FileIndex index;
  index.chunk_ticks = 5;
  return write_record(kIndexTag, write_index(index));
}

Bytes parts_record(const std::vector<PartEntry>& parts, std::uint32_t flags = kCritical) {
  return write_record(kPartsTag, write_parts(parts), flags);
}

std::set<int> issues_of(const Bytes& bytes) {
  const auto issues = validate_scene(*memory_source(bytes));
  REQUIRE(issues.ok());
  std::set<int> numbers;
  for (const Issue& issue : *issues) numbers.insert(issue.number);
  CHECK(read_scene(memory_source(bytes)).ok() == issues->empty());
  return numbers;
}

}  // namespace

TEST_CASE("a scene in parts keeps its primitives, parts and window") {
  const Scene scene = scene_in_parts();
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const auto reader = reader_of(scene, profile);
    CHECK(reader->metadata().window == scene.metadata.window);
    REQUIRE(reader->parts().size() == 3);
    for (std::size_t p = 0; p < 3; ++p) {
      CHECK(reader->parts()[p].begin_ticks == kParts[p].begin_ticks);
      CHECK(reader->parts()[p].end_ticks == kParts[p].end_ticks);
    }
    CHECK(reader->parts()[1].primitives == 0);
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
  // Each part has its own, whatever the order within it.
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

TEST_CASE("a moment has the segments of its part alone") {
  const auto reader = reader_of(scene_in_parts(), Profile::kQuantised);
  const auto parts_at = [&](double t) {
    std::set<std::uint32_t> parts;
    for (const std::uint32_t s : reader->segments_between(t, t)) {
      parts.insert(reader->segments()[s].part);
    }
    return parts;
  };
  const std::set<std::uint32_t> first = {0}, last = {2};
  CHECK(parts_at(-5) == first);
  CHECK(parts_at(0) == first);
  CHECK(parts_at(13.49999) == first);
  CHECK(parts_at(13.5).empty());
  CHECK(parts_at(24.99999).empty());
  CHECK(parts_at(25) == last);
  CHECK(parts_at(kFrames) == last);
  CHECK(parts_at(1e6) == last);
}

TEST_CASE("one part that lasts as long as the scene is as good as none") {
  Scene scene = random_scene(50, 0, kFrames, 3);
  scene.parts = {{0, kFrames, 50}};
  const auto reader = reader_of(scene, Profile::kLossless);
  CHECK(reader->parts() == scene.parts);
}

TEST_CASE("parts that make no sense are not written") {
  Scene scene = random_scene(50, 0, kFrames, 3);
  for (const std::vector<ScenePart>& parts : std::vector<std::vector<ScenePart>>{
           {{0, 20, 25}, {20, 40, 24}}, {{0, 41, 50}}, {{5, 5, 50}}, {{NAN, 40, 50}}}) {
    scene.parts = parts;
    CHECK(encode_scene(scene, {}).status().code() == StatusCode::kUsage);
  }
  scene.parts.clear();
  scene.metadata.window = CaptureWindow{10, 49, 0, 0};
  CHECK(encode_scene(scene, {}).status().code() == StatusCode::kUsage);
}

TEST_CASE("a cursor finds the first segment of each part that has one, and no other") {
  const std::vector<PartEntry> parts = {{0, 1, 0}, {0, 1, 2}, {0, 1, 0}, {0, 1, 0},
                                        {0, 1, 1}, {0, 1, 3}, {0, 1, 0}};
  PartCursor cursor(parts);
  std::vector<std::uint64_t> first;
  for (std::uint64_t segment = 0; segment < 9; ++segment) {
    if (cursor.begins_part(segment)) first.push_back(segment);
  }
  CHECK(first == std::vector<std::uint64_t>{0, 2, 3, 6});  // 6: the last, which has none
  PartCursor none(std::span<const PartEntry>{});
  CHECK_FALSE(none.begins_part(0));
}

// Where each segment walks all parts this takes minutes, and ctest ends it.
TEST_CASE("a head of as many parts as segments is read in one walk over both") {
  constexpr std::uint32_t kMany = 600000;
  const Bytes meta = metadata_record();
  const Bytes parts = parts_record(std::vector<PartEntry>(kMany, {0, kFrames, 1}));
  FileIndex index;
  index.chunk_ticks = 5;
  index.primitives = kMany;
  std::uint64_t at =
      kHeaderBytes + meta.size() + parts.size() + kRecordHeaderBytes + index_bytes(kMany, 0);
  for (std::uint32_t i = 0; i < kMany; ++i, at += kRecordHeaderBytes) {
    index.segments.push_back({{-1, 0, 0, at, kRecordHeaderBytes, 1}, {}, 0});
  }
  Bytes file = file_of({meta, parts, write_record(kIndexTag, write_index(index))});
  FileHeader header;
  header.head_bytes = file.size();
  header.file_bytes = at;
  const Bytes start = write_header(header);
  std::copy(start.begin(), start.end(), file.begin());
  file.resize(at);
  const auto reader = SceneReader::open(memory_source(std::move(file)));
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  CHECK((*reader)->parts().size() == kMany);
  CHECK((*reader)->segments().back().part == kMany - 1);
}

TEST_CASE("damaged parts and windows are refused by number") {
  const Bytes meta = metadata_record(), index = index_record();
  const auto window = [](const CaptureWindow& w, std::uint32_t flags = 0) {
    return write_record(kWindowTag, write_window(w), flags);
  };
  const Bytes none = parts_record({}), good = parts_record({{0, 10, 0}, {5, kFrames, 0}});
  CHECK(issues_of(file_of({meta, good, window({0, 40, 1, 1}), index})).empty());
  CHECK(issues_of(file_of({window({60, 100, 1, 1}), meta, index})).empty());
  CHECK(issues_of(file_of({meta, none, index})) == std::set<int>{311});
  CHECK(issues_of(file_of({meta, index, good})) == std::set<int>{311});
  CHECK(issues_of(file_of({meta, good, good, index})) == std::set<int>{114});
  CHECK(issues_of(file_of({meta, parts_record({{0, 10, 1}}), index})).count(311) == 1);
  CHECK(issues_of(file_of({meta, parts_record({{0, 41, 0}}), index})).count(311) == 1);
  CHECK(issues_of(file_of({meta, parts_record({{3, 3, 0}}), index})).count(311) == 1);
  CHECK(issues_of(file_of({meta, parts_record({{NAN, 3, 0}}), index})).count(311) == 1);
  CHECK(issues_of(file_of({meta, parts_record({{0, 40, 0}}, 0), index})).count(116) == 1);
  CHECK(issues_of(file_of({meta, window({61, 100, 1, 1}), index})) == std::set<int>{206});
  CHECK(issues_of(file_of({meta, window({0, 40, 1, 1}, kCritical), index})).count(113) == 1);
  CHECK(issues_of(file_of({meta, write_record(kWindowTag, Bytes(23), 0), index})) ==
        std::set<int>{206});
  // A count that no payload could hold.
  Bytes huge = write_parts({});
  huge.assign(4, 0xFF);
  CHECK(issues_of(file_of({meta, write_record(kPartsTag, huge), index})).count(311) == 1);
}

TEST_CASE("a part that has too many segments, or one that it cuts away, is refused") {
  const Scene scene = scene_in_parts();
  const auto bytes = encode_scene(scene, {});
  REQUIRE(bytes.ok());
  const std::string text(bytes->begin(), bytes->end());
  const std::size_t at = text.find("PART") + kRecordHeaderBytes;
  const auto changed = [&](std::size_t offset, const auto& value) {
    Bytes damaged = *bytes;
    std::memcpy(damaged.data() + at + offset, &value, sizeof value);
    const std::size_t record = at - kRecordHeaderBytes;
    const std::span<const std::uint8_t> payload(damaged.data() + at, 4 + 3 * 20);
    const std::uint64_t sums = checksum(payload);
    std::memcpy(damaged.data() + record + 16, &sums, 8);
    const std::uint64_t head = checksum({damaged.data() + record, 24});
    std::memcpy(damaged.data() + record + 24, &head, 8);
    return read_scene(memory_source(damaged, "x.stgs")).status();
  };
  CHECK(changed(0, std::uint32_t{3}).ok());
  // Then some of its segments come after later ones, or those of the next before earlier ones.
  CHECK(changed(20, std::uint32_t{1}).message().find("issue 303") != std::string::npos);
  CHECK(changed(20, std::uint32_t{0xFFFFFFFF}).message().find("issue 303") != std::string::npos);
  // The last part ends before its segments of the end begin.
  CHECK(changed(52, 25.5).message().find("issue 302") != std::string::npos);
}
