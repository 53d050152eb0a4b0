// SPDX-License-Identifier: Apache-2.0
// What the index tells, and what a reader refuses of it (spec 5).
#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "catch.h"
#include "container/segment_times.h"
#include "core/bytes.h"
#include "head_fixture.h"
#include "quantise/segmenter.h"
#include "scene_fixture.h"

using namespace stgs;
using stgs::testing::body_of;
using stgs::testing::file_of;
using stgs::testing::head_of;
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

// The first finding where the head of a sound file is changed.
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

// The payload of an index of one part, from its first segment on.
Bytes index_of(const std::vector<std::uint64_t>& numbers, std::uint64_t primitives,
               std::uint64_t segments, std::uint64_t skip = 0) {
  ByteWriter out;
  out.f64(7.5);
  out.varint(primitives);
  out.varint(0);
  out.varint(1);
  out.f64(0);
  out.f64(kFrames);
  out.varint(4 * skip);
  out.varint(segments);
  for (const std::uint64_t number : numbers) out.varint(number);
  return out.take();
}

// A body of so many records that no reader looks into, of `payload` bytes each.
Bytes filler(std::size_t records, std::size_t payload) {
  return Bytes(records * (kRecordHeaderBytes + payload));
}

Bytes file_with_index(const Bytes& payload, const Bytes& body) {
  FileMetadata metadata;
  metadata.scene.frames = kFrames;
  return file_of(
      {write_record(kMetadataTag, write_metadata(metadata)), write_record(kIndexTag, payload)},
      body);
}

int opening(const Bytes& payload, const Bytes& body) {
  const auto reader = SceneReader::open(memory_source(file_with_index(payload, body)));
  if (reader.ok()) return 0;
  const std::string& message = reader.status().message();
  return std::stoi(message.substr(message.find("issue ") + 6));
}

}  // namespace

TEST_CASE("an index comes back as it was written, in a few bytes a record") {
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const Bytes bytes = small_file(profile, 4000);
    const FileHead head = head_of(bytes);
    const Bytes index = write_index(head.index, head.parts);
    CHECK(with_index(bytes, head) == bytes);
    std::vector<SegmentEntry> segments = head.index.segments;
    const std::size_t records = records_of(segments).size();
    CHECK(index.size() < 100 + 7 * records);
    // Without gaps from the head on.
    std::uint64_t at = head.header.head_bytes;
    for (const IndexEntry* record : records_of(segments)) {
      CHECK(record->offset == at);
      at += record->bytes;
    }
    CHECK(at == bytes.size());
  }
}

TEST_CASE("the index's claims are checked before anything is allocated") {
  const Bytes whole = small_file();
  const auto base = [](FileHead& head) -> IndexEntry& { return head.index.segments[0].base; };
  CHECK(first_issue(whole, [](FileHead& h) { h.index.chunk_ticks = 0.0; }) == 301);
  CHECK(first_issue(whole, [](FileHead& h) { h.index.chunk_ticks = INFINITY; }) == 301);
  CHECK(first_issue(whole, [](FileHead& h) { ++h.index.primitives; }) == 306);
  CHECK(first_issue(whole, [&](FileHead& h) { base(h).bytes = 1ull << 62; }) == 304);
  CHECK(first_issue(whole, [&](FileHead& h) { base(h).bytes = ~0ull; }) == 304);
  CHECK(first_issue(whole, [&](FileHead& h) { base(h).primitives = 0; }) == 305);
  CHECK(first_issue(whole, [&](FileHead& h) { base(h).primitives = ~0u; }) == 305);
  FileHead sound = head_of(whole);
  const auto most = static_cast<std::uint32_t>(16 * base(sound).bytes);
  CHECK(first_issue(whole, [&](FileHead& h) { base(h).primitives = most; }) == 306);
  CHECK(first_issue(whole, [&](FileHead& h) { base(h).primitives = most + 1; }) == 305);
  CHECK(first_issue(whole, [](FileHead& h) { h.index.segments.back().base.slot = 1000; }) == 302);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].skip = 1; }) == 304);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].skip = ~0ull; }) == 304);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].end = kFrames + 0x1p-21; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].end = 0x1p33; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].cut = {-1, 10}; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].cut = {10, 10}; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].cut = {0, kFrames + 1}; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].begin = NAN; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].chunk_ticks = 0x1p33; }) == 301);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].chunk_ticks = 0x1p-21; }) == 301);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].begin = kFrames; }) == 311);
  CHECK(first_issue(whole, [](FileHead& h) { h.parts[0].begin = kFrames - 0.5; }) == 302);
  CHECK(first_issue(whole, [](FileHead& h) {
          std::swap(h.index.segments[1].base.level, h.index.segments.back().base.level);
          std::swap(h.index.segments[1].base.slot, h.index.segments.back().base.slot);
        }) == 303);
  ReadLimits limits;
  limits.max_primitives = 39;
  CHECK(issues_of(whole, limits) == std::set<int>{307});
  limits = {};
  limits.max_memory = 2000;
  CHECK(issues_of(whole, limits) == std::set<int>{308});
}

TEST_CASE("counts that no payload could hold are refused") {
  const std::uint64_t huge = ~0ull;
  CHECK(opening(index_of({}, 0, huge), {}) == 300);
  CHECK(opening(index_of({0, huge}, 0, 1), {}) == 300);     // tiers
  CHECK(opening(index_of({0, 4 * 257}, 0, 1), {}) == 300);  // one tier too many
  CHECK(opening(index_of({0, 4 * 256}, 0, 1), {}) == 300);  // cut off
  CHECK(opening(index_of({0, 6, 5, 10, huge}, 5, 1), filler(1, 10)) == 300);
  for (const std::size_t at : {8u, 9u, 10u}) {  // primitives, totals, parts
    Bytes payload = index_of({}, 0, 0);
    ByteWriter out;
    out.bytes(std::span(payload).first(at));
    out.varint(huge);
    CHECK(opening(out.take(), {}) == 300);
  }
}

TEST_CASE("a number has one form") {
  const auto with = [](std::initializer_list<std::uint8_t> number) {
    ByteWriter out;
    out.f64(7.5);
    for (const std::uint8_t byte : number) out.u8(byte);
    out.varint(0);
    out.varint(0);
    return opening(out.take(), {});
  };
  CHECK(with({0}) == 0);
  CHECK(with({0x80, 0x00}) == 300);
  CHECK(with({0x81, 0x00}) == 300);
  CHECK(with({0x80, 0x01}) == 306);
  CHECK(with({0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x01}) == 306);
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

TEST_CASE("places that there are none are refused") {
  // Place, shape, primitives, bytes: the chunk has 7.5 of 30 ticks.
  const Bytes body = filler(2, 10);
  CHECK(opening(index_of({1, 4, 5, 10}, 5, 1), body) == 0);
  CHECK(opening(index_of({1 + 32 * 7, 4, 5, 10}, 5, 1), body) == 0);
  CHECK(opening(index_of({1 + 32 * 8, 4, 5, 10}, 5, 1), body) == 302);
  CHECK(opening(index_of({32, 4, 5, 10}, 5, 1), body) == 302);  // persistent, of slot 1
  CHECK(opening(index_of({1 + (1ull << 37), 4, 5, 10}, 5, 1), body) == 302);
  CHECK(opening(index_of({~0ull, 4, 5, 10}, 5, 1), body) == 302);
  CHECK(opening(index_of({0, 4, 5, 10, 0, 4, 5, 10}, 10, 2), body) == 302);  // persistent twice
  CHECK(opening(index_of({1, 4, 5, 10, 1, 4, 5, 10}, 10, 2), body) == 0);    // slots 0 and 1
  CHECK(opening(index_of({1, 4, 5, 10, 2, 4, 5, 10}, 10, 2), body) == 303);  // the longer first
  CHECK(opening(index_of({2, 4, 5, 10, 1, 4, 5, 10}, 10, 2), body) == 0);
  CHECK(opening(index_of({1, 4, 5, 10, 0, 4, 5, 10}, 10, 2), body) == 303);
  CHECK(opening(index_of({1, 4, 5, 10}, 5, 1, 42), body) == 0);  // bytes that it does not list
  CHECK(opening(index_of({1, 4, 5, 10}, 5, 1, 43), body) == 304);
}

TEST_CASE("refinements that a version does not know are passed over") {
  const Bytes body = filler(4, 10);
  const auto with = [](std::uint64_t layer) {
    return index_of({1, 6, 5, 10, 1, layer, 10, 1, 4, 6, 10}, 11, 2);
  };
  CHECK(opening(with(512), body) == 0);
  CHECK(opening(with(0xFFFF), body) == 0);
  CHECK(opening(with(0x10000), body) == 303);
  CHECK(opening(with(511), body) == 303);
  CHECK(opening(index_of({1, 6, 5, 10, 1, 512, 103}, 5, 1), body) == 304);
  CHECK(opening(index_of({1, 2, 1, 512, 10, 1, 4, 6, 10}, 6, 2), body) == 0);  // no tiers
  CHECK(opening(index_of({1, 3, 10, 1, 512, 10}, 0, 1), body) == 300);
  CHECK(opening(index_of({1, 0}, 0, 1), body) == 300);
  CHECK(opening(index_of({1, 2, 0}, 0, 1), body) == 300);
  const auto reader = SceneReader::open(memory_source(file_with_index(with(512), body)));
  REQUIRE(reader.ok());
  REQUIRE((*reader)->segments().size() == 2);
  const auto& segments = (*reader)->segments();
  CHECK(segments[1].offset == segments[0].offset + 2 * segments[0].bytes);
}

TEST_CASE("an index of very many parts is read in one walk") {
  constexpr std::uint32_t kMany = 600000;
  FileHead head;
  head.index.chunk_ticks = 5;
  head.index.primitives = kMany;
  for (std::uint32_t i = 0; i < kMany; ++i) {
    head.parts.push_back({0, kFrames, 0});
    head.index.segments.push_back({{-1, 0, 0, 0, kRecordHeaderBytes, 1}, {}, i});
  }
  const auto reader = SceneReader::open(
      memory_source(file_with_index(write_index(head.index, head.parts), filler(kMany, 0))));
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  CHECK((*reader)->parts().size() == kMany);
  CHECK((*reader)->segments().back().part == kMany - 1);
}

TEST_CASE("a chunk is chosen that makes segments neither tiny nor wasteful") {
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
  // Lives of 9 and of 140 frames: the longer the lives, the longer the chunk.
  CHECK(chosen(50000, 2.0f) >= 8);
  CHECK(chosen(50000, 2.0f) <= 64);
  CHECK(chosen(50000, 30.0f) > chosen(50000, 2.0f));
  // Few primitives are not worth many segments.
  CHECK(chosen(500, 2.0f) > chosen(50000, 2.0f));
  CHECK(chosen(0, 2.0f) >= kLong);
}

TEST_CASE("the segments of a moment are those that a look at all of them finds") {
  constexpr double kEnd = 1000;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<SegmentInfo> segments(400);
  for (SegmentInfo& segment : segments) {
    segment.begin_ticks = std::floor(kEnd * uniform(random));
    const double length = std::floor(std::exp2(10 * uniform(random))) - 1;  // 0: not shown
    segment.end_ticks = std::min(segment.begin_ticks + length, kEnd);
  }
  const SegmentTimes times(segments, kEnd);
  std::size_t found = 0, last = 0;
  for (double t0 = -3; t0 <= kEnd + 3; t0 += 0.5) {
    for (const double length : {0.0, 7.0, 300.0}) {
      std::vector<std::uint32_t> expected;
      const double first = std::clamp(t0, 0.0, kEnd), end = std::clamp(t0 + length, 0.0, kEnd);
      for (std::uint32_t i = 0; i < segments.size(); ++i) {
        const SegmentInfo& one = segments[i];
        const bool ends_after = first < one.end_ticks || one.end_ticks == kEnd;
        if (one.is_shown() && one.begin_ticks <= end && ends_after) expected.push_back(i);
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
