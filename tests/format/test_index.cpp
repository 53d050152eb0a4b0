// SPDX-License-Identifier: Apache-2.0
// The index of a file, and the indices that a reader rejects (spec 5).
#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "catch.h"
#include "container/segment_times.h"
#include "fixtures/scene_fixture.h"
#include "head_fixture.h"
#include "quantise/segmenter.h"

using namespace stgs;
using stgs::testing::body_of;
using stgs::testing::file_of;
using stgs::testing::head_of;
using stgs::testing::index_payload;
using stgs::testing::random_scene;
using stgs::testing::with_index;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::uint32_t kFrames = 30;

Bytes small_file(Profile profile = Profile::kLossless, std::size_t n = 40) {
  WriteSettings settings;
  settings.profile = profile;
  settings.chunk_seconds = 0.25;
  auto bytes = encode_scene(random_scene(n, 1, kFrames, 21), settings);
  REQUIRE(bytes.ok());
  return testing::without_copy(std::move(*bytes));
}

std::set<int> issues_of(const Bytes& bytes, const ReadLimits& limits = {}) {
  const auto issues = validate_scene(*memory_source(bytes), limits);
  REQUIRE(issues.ok());
  std::set<int> numbers;
  for (const Issue& issue : *issues) numbers.insert(issue.number);
  return numbers;
}

// The first issue after `change` has modified the head of an intact file.
template <typename Change>
int first_issue(const Bytes& bytes, const Change& change) {
  FileHead head = head_of(bytes);
  change(head);
  const Bytes damaged = with_index(bytes, head);
  const Status status = read_scene(memory_source(damaged, "x.stgs")).status();
  CHECK_FALSE(status.ok());
  const auto issues = validate_scene(*memory_source(damaged));
  REQUIRE(issues.ok());
  REQUIRE_FALSE(issues->empty());
  CHECK(status.message().find(fmt::format("issue {})", issues->front().number)) !=
        std::string::npos);
  return issues->front().number;
}

constexpr std::uint64_t kDummyAt = 300;  // of two bytes, as all offsets here

Bytes metadata_record() {
  FileMetadata metadata;
  metadata.scene.frames = kFrames;
  return write_record(kMetadataTag, write_metadata(metadata));
}

// The payload of an index of one run, whose records begin `skip` bytes after the head; `numbers`
// are the fields of its segments.
Bytes index_of(const std::vector<std::uint64_t>& numbers, std::uint64_t primitives,
               std::uint64_t segments, std::uint64_t skip = 0) {
  const auto with_offset = [&](std::uint64_t offset) {
    ByteWriter out;
    for (const std::uint64_t number : {primitives, 0ul, 0ul, 1ul, 0ul}) out.varint(number);
    for (const double time : {0.0, double{kFrames}, 0.0, double{kFrames}, 7.5}) out.f64(time);
    out.varint(offset);
    out.varint(segments);
    for (const std::uint64_t number : numbers) out.varint(number);
    return out.take();
  };
  const std::uint64_t head = kHeaderBytes + metadata_record().size() + kRecordHeaderBytes;
  return with_offset(head + with_offset(kDummyAt).size() + skip);
}

// A body of `records` records of `payload` bytes each, which opening does not read.
Bytes filler(std::size_t records, std::size_t payload) {
  return Bytes(records * (kRecordHeaderBytes + payload));
}

Bytes file_with_index(const Bytes& payload, const Bytes& body) {
  return file_of({metadata_record(), write_record(kIndexTag, payload)}, body);
}

int open_issue(const Bytes& payload, const Bytes& body) {
  const auto reader = SceneReader::open(memory_source(file_with_index(payload, body)));
  if (reader.ok()) return 0;
  const std::string& message = reader.status().message();
  return std::stoi(message.substr(message.find("issue ") + 6));
}

}  // namespace

TEST_CASE("an index round-trips and takes a few bytes per record") {
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const Bytes bytes = small_file(profile, 4000);
    const FileHead head = head_of(bytes);
    const Bytes index = index_payload(head);
    CHECK(with_index(bytes, head) == bytes);
    FileIndex copy = head.index;
    const std::size_t records = records_of(copy).size();
    CHECK(index.size() < 120 + 7 * records);
    // The records follow the head without gaps.
    std::uint64_t at = head.header.head_bytes;
    for (const RecordRange* record : records_of(copy)) {
      CHECK(record->offset == at);
      at += record->bytes;
    }
    CHECK(at == bytes.size());
  }
}

TEST_CASE("the reader rejects an index that contradicts the file before allocating memory") {
  const Bytes original = small_file();
  const auto base = [](FileHead& head) -> IndexEntry& { return head.index.segments[0].base; };
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].chunk_ticks = 0.0; }) == 301);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].chunk_ticks = INFINITY; }) == 301);
  CHECK(first_issue(original, [&](FileHead& h) { base(h).bytes = 1ull << 62; }) == 304);
  CHECK(first_issue(original, [&](FileHead& h) { base(h).bytes = ~0ull; }) == 304);
  CHECK(first_issue(original, [&](FileHead& h) { base(h).primitives = 0; }) == 305);
  CHECK(first_issue(original, [&](FileHead& h) { base(h).primitives = ~0u; }) == 305);
  FileHead intact = head_of(original);
  const auto limit =
      static_cast<std::uint32_t>(kMaxPrimitivesPerByte * (base(intact).bytes - kRecordHeaderBytes));
  CHECK(first_issue(original, [&](FileHead& h) { base(h).primitives = limit + 1; }) == 305);
  CHECK(first_issue(original, [](FileHead& h) { h.index.segments.back().base.slot = 1000; }) ==
        302);
  CHECK(first_issue(original, [](FileHead& h) { ++h.index.segments[0].base.offset; }) == 304);
  CHECK(first_issue(original, [](FileHead& h) { --h.index.segments[0].base.offset; }) == 304);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].end = kFrames + 0x1p-21; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].end = 0x1p33; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].displayed = {-1, 10}; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].displayed = {10, 10}; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].displayed = {0, kFrames + 1}; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].begin = NAN; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].chunk_ticks = 0x1p33; }) == 301);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].chunk_ticks = 0x1p-21; }) == 301);
  CHECK(first_issue(original, [](FileHead& h) { h.parts[0].begin = kFrames; }) == 311);
  CHECK(first_issue(original, [](FileHead& h) {
          h.parts[0].begin = h.parts[0].displayed.begin = kFrames - 0.5;
        }) == 302);
  CHECK(first_issue(original, [](FileHead& h) {
          std::swap(h.index.segments[1].base.level, h.index.segments.back().base.level);
          std::swap(h.index.segments[1].base.slot, h.index.segments.back().base.slot);
        }) == 303);
  ReadLimits limits;
  limits.max_primitives = 39;
  CHECK(issues_of(original, limits) == std::set<int>{307});
  limits = {};
  limits.max_memory = 2000;
  CHECK(issues_of(original, limits) == std::set<int>{308});
}

TEST_CASE("counts that exceed the payload are rejected") {
  const std::uint64_t huge = ~0ull;
  CHECK(open_issue(index_of({}, 0, huge), {}) == 300);
  CHECK(open_issue(index_of({0, huge}, 0, 1), {}) == 300);     // tiers
  CHECK(open_issue(index_of({0, 4 * 257}, 0, 1), {}) == 300);  // one tier more than allowed
  CHECK(open_issue(index_of({0, 4 * 256}, 0, 1), {}) == 300);  // truncated
  CHECK(open_issue(index_of({0, 6, 5, 10, huge}, 5, 1), filler(1, 10)) == 300);
  for (const std::size_t at : {1u, 2u, 3u}) {  // totals, links, runs
    Bytes payload = index_of({}, 0, 0);
    ByteWriter out;
    out.bytes(std::span(payload).first(at));
    out.varint(huge);
    CHECK(open_issue(out.take(), {}) == 300);
  }
}

TEST_CASE("only the shortest encoding of a number is accepted") {
  const auto with = [](std::initializer_list<std::uint8_t> number) {
    ByteWriter out;
    for (const std::uint8_t byte : number) out.u8(byte);
    for (int i = 0; i < 3; ++i) out.varint(0);
    return open_issue(out.take(), {});
  };
  CHECK(with({0}) == 0);
  CHECK(with({0x80, 0x00}) == 300);
  CHECK(with({0x81, 0x00}) == 300);
  CHECK(with({0x80, 0x01}) == 0);
  CHECK(with({0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x01}) == 307);
  CHECK(with({0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x02}) == 300);
  CHECK(with({0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x81, 0x00}) == 300);
  for (int shift = 0; shift < 64; ++shift) {
    ByteWriter out;
    out.varint(1ull << shift);
    out.varint((1ull << shift) - 1);
    ByteReader in(out.view());
    CHECK(in.varint() == 1ull << shift);
    CHECK(in.varint() == (1ull << shift) - 1);
    CHECK(in.ok());
    CHECK(in.left() == 0);
  }
}

TEST_CASE("invalid segment positions are rejected") {
  // Position, shape, primitives and bytes of a segment; a chunk is 7.5 of 30 ticks.
  const Bytes body = filler(2, 10);
  CHECK(open_issue(index_of({1, 4, 5, 10}, 5, 1), body) == 0);
  CHECK(open_issue(index_of({1 + 32 * 7, 4, 5, 10}, 5, 1), body) == 0);
  CHECK(open_issue(index_of({1 + 32 * 8, 4, 5, 10}, 5, 1), body) == 302);
  CHECK(open_issue(index_of({32, 4, 5, 10}, 5, 1), body) == 302);  // persistent, slot 1
  CHECK(open_issue(index_of({1 + (1ull << 37), 4, 5, 10}, 5, 1), body) == 302);
  CHECK(open_issue(index_of({~0ull, 4, 5, 10}, 5, 1), body) == 302);
  CHECK(open_issue(index_of({0, 4, 5, 10, 0, 4, 5, 10}, 10, 2), body) == 302);  // two persistent
  CHECK(open_issue(index_of({1, 4, 5, 10, 1, 4, 5, 10}, 10, 2), body) == 0);    // slots 0 and 1
  CHECK(open_issue(index_of({1, 4, 5, 10, 2, 4, 5, 10}, 10, 2), body) == 303);  // longer first
  CHECK(open_issue(index_of({2, 4, 5, 10, 1, 4, 5, 10}, 10, 2), body) == 0);
  CHECK(open_issue(index_of({1, 4, 5, 10, 0, 4, 5, 10}, 10, 2), body) == 303);
  CHECK(open_issue(index_of({1, 4, 5, 10}, 5, 1, 34), body) == 0);  // unlisted bytes
  CHECK(open_issue(index_of({1, 4, 5, 10}, 5, 1, 35), body) == 304);
}

TEST_CASE("unknown refinement layers are skipped") {
  const Bytes body = filler(4, 10);
  const auto with = [](std::uint64_t layer) {
    return index_of({1, 6, 5, 10, 1, layer, 10, 1, 4, 6, 10}, 11, 2);
  };
  CHECK(open_issue(with(512), body) == 0);
  CHECK(open_issue(with(0xFFFF), body) == 0);
  CHECK(open_issue(with(0x10000), body) == 303);
  CHECK(open_issue(with(511), body) == 303);
  CHECK(open_issue(index_of({1, 6, 5, 10, 1, 512, 79}, 5, 1), body) == 304);
  CHECK(open_issue(index_of({1, 6, 5, 10, 2, 512, 10, 512, 10}, 5, 1), body) == 303);
  CHECK(open_issue(index_of({1, 6, 5, 10, 2, 512, 10, 513, 10}, 5, 1), body) == 0);
  CHECK(open_issue(index_of({1, 2, 1, 512, 10, 1, 4, 6, 10}, 6, 2), body) == 0);  // no tiers
  CHECK(open_issue(index_of({1, 3, 10, 1, 512, 10}, 0, 1), body) == 300);
  CHECK(open_issue(index_of({1, 0}, 0, 1), body) == 300);
  CHECK(open_issue(index_of({1, 2, 0}, 0, 1), body) == 300);
  const auto reader = SceneReader::open(memory_source(file_with_index(with(512), body)));
  REQUIRE(reader.ok());
  REQUIRE((*reader)->segments().size() == 2);
  const auto& segments = (*reader)->segments();
  CHECK(segments[1].offset == segments[0].offset + 2 * segments[0].bytes);
}

TEST_CASE("an index of 600,000 parts is read in linear time") {
  constexpr std::uint32_t kMany = 600000;
  FileHead head;
  head.index.primitives = kMany;
  for (std::uint32_t i = 0; i < kMany; ++i) {
    head.parts.push_back({i, 0, kFrames, {0, kFrames}, 5});
    head.index.segments.push_back({{{0, kRecordHeaderBytes + 1}, -1, 0, 0, 1}, {}, i});
  }
  const auto reader =
      SceneReader::open(memory_source(testing::file_with(head, kFrames, filler(kMany, 1))),
                        ReadLimits::of(kMany, std::uint64_t{16} << 30));
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  CHECK((*reader)->parts().size() == kMany);
  CHECK((*reader)->segments().back().part == kMany - 1);
}

TEST_CASE("the chunk length grows with lifespans and shrinks with the number of primitives") {
  constexpr std::uint32_t kLong = 3000;
  const auto chosen = [](std::size_t n, float sigma) {
    Scene scene = random_scene(n, 0, kLong, 5);
    std::mt19937 random(3);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    for (std::size_t i = 0; i < n; ++i) {
      scene.gaussians.time[i] = kLong * uniform(random);
      scene.gaussians.sigma[i] = sigma;
      scene.gaussians.radius[i] = 0.0f;
      scene.gaussians.opacity_logit[i] = 3.0f;
    }
    const PartRange all = {0, static_cast<std::uint32_t>(n), {0, kLong}};
    return choose_chunk(scene.gaussians, {&all, 1});
  };
  // Lifespans of 9 and of 140 frames: longer lifespans take longer chunks.
  CHECK(chosen(50000, 2.0f) >= 8);
  CHECK(chosen(50000, 2.0f) <= 64);
  CHECK(chosen(50000, 30.0f) > chosen(50000, 2.0f));
  // Few primitives do not justify many segments.
  CHECK(chosen(500, 2.0f) > chosen(50000, 2.0f));
  CHECK(chosen(0, 2.0f) >= kLong);
}

TEST_CASE("the segments in an interval are those that a linear search finds") {
  constexpr double kEnd = 1000;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<SegmentInfo> segments(400);
  for (SegmentInfo& segment : segments) {
    segment.begin_ticks = std::floor(kEnd * uniform(random));
    const double length = std::floor(std::exp2(10 * uniform(random))) - 1;  // 0: at most one time
    segment.end_ticks = std::min(segment.begin_ticks + length, kEnd);
    segment.needed_at_end = segment.end_ticks == kEnd || uniform(random) < 0.5;
  }
  const SegmentTimes times(segments, kEnd);
  std::size_t found = 0, last = 0;
  for (double t0 = -3; t0 <= kEnd + 3; t0 += 0.5) {
    for (const double length : {0.0, 7.0, 300.0}) {
      std::vector<std::uint32_t> expected;
      const double first = std::clamp(t0, 0.0, kEnd), end = std::clamp(t0 + length, 0.0, kEnd);
      for (std::uint32_t i = 0; i < segments.size(); ++i) {
        const SegmentInfo& segment = segments[i];
        const bool ends_after =
            first < segment.end_ticks || (first == segment.end_ticks && segment.needed_at_end);
        if (segment.is_needed() && segment.begin_ticks <= end && ends_after) expected.push_back(i);
      }
      REQUIRE(times.between(t0, t0 + length) == expected);
      found += expected.size();
      last = expected.size();
    }
  }
  CHECK(found > 10000);
  CHECK(last > 10);  // at the end of the timeline
  CHECK(SegmentTimes().between(0, 1).empty());
}
