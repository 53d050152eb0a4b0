// SPDX-License-Identifier: Apache-2.0
// What a reader and the validator say of damaged and hostile files.
#include <sys/resource.h>
#include <xxhash.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <set>

#include "head_fixture.h"
#include "scene_fixture.h"

using namespace stgs;
using stgs::testing::head_of;
using stgs::testing::random_scene;
using stgs::testing::with_index;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr std::size_t kHeader = 40, kRecord = 32;

Bytes small_file(Profile profile, std::size_t n = 40, bool own_layouts = false) {
  WriteSettings settings;
  settings.profile = profile;
  settings.chunk_seconds = 0.5;
  settings.own_layouts = own_layouts;
  auto bytes = encode_scene(random_scene(n, 1, 30, 21), settings);
  REQUIRE(bytes.ok());
  return std::move(*bytes);
}

// Opens and decodes all of it.
Status read_all(Bytes bytes) {
  return read_scene(memory_source(std::move(bytes), "x.stgs")).status();
}

std::vector<Issue> issues_of(Bytes bytes, const ReadLimits& limits = {}) {
  auto issues = validate_scene(*memory_source(std::move(bytes), "x.stgs"), limits);
  INFO(issues.status().message());
  REQUIRE(issues.ok());
  return std::move(*issues);
}

std::set<int> numbers_of(const std::vector<Issue>& issues) {
  std::set<int> out;
  for (const Issue& issue : issues) out.insert(issue.number);
  return out;
}

template <typename Value>
Value get(const Bytes& bytes, std::size_t at) {
  Value v;
  std::memcpy(&v, bytes.data() + at, sizeof v);
  return v;
}
template <typename Value>
void put(Bytes& bytes, std::size_t at, Value v) {
  std::memcpy(bytes.data() + at, &v, sizeof v);
}

void seal_header(Bytes& bytes) {
  put<std::uint64_t>(bytes, 32, XXH3_64bits(bytes.data(), 32));
}
// Makes the checksums of the record at `at` right again.
void seal_record(Bytes& bytes, std::size_t at) {
  const auto length = get<std::uint64_t>(bytes, at + 8);
  if (at + kRecord + length <= bytes.size()) {
    put<std::uint64_t>(bytes, at + 16, XXH3_64bits(bytes.data() + at + kRecord, length));
  }
  put<std::uint64_t>(bytes, at + 24, XXH3_64bits(bytes.data() + at, 24));
}
// The first record of this tag.
std::size_t record_at(const Bytes& bytes, const char* tag) {
  std::size_t at = kHeader;
  while (std::memcmp(bytes.data() + at, tag, 4) != 0) {
    at += kRecord + get<std::uint64_t>(bytes, at + 8);
    REQUIRE(at + kRecord <= bytes.size());
  }
  return at;
}
std::size_t metadata_at(const Bytes& bytes) {
  return record_at(bytes, "META");
}
std::size_t layouts_at(const Bytes& bytes) {
  return record_at(bytes, "LAYT");
}
std::size_t index_at(const Bytes& bytes) {
  return record_at(bytes, "INDX");
}
std::size_t body_at(const Bytes& bytes) {
  return get<std::uint64_t>(bytes, 24);
}

// Changes one field of a valid file, seals the checksums around it, and returns the first number.
template <typename Value>
int first_issue(Bytes bytes, std::size_t record, std::size_t offset, Value value) {
  put<Value>(bytes, record + kRecord + offset, value);
  seal_record(bytes, record);
  const Status status = read_all(bytes);
  CHECK_FALSE(status.ok());
  const auto issues = issues_of(bytes);
  REQUIRE_FALSE(issues.empty());
  INFO(status.message());
  CHECK(status.message().find(fmt::format("issue {})", issues.front().number)) !=
        std::string::npos);
  return issues.front().number;
}

}  // namespace

TEST_CASE("a sound file has no issues") {
  CHECK(issues_of(small_file(Profile::kLossless)).empty());
  CHECK(issues_of(small_file(Profile::kQuantised)).empty());
  CHECK(issues_of(small_file(Profile::kQuantised, 3000)).empty());
  CHECK(issues_of(small_file(Profile::kLossless, 40, true)).empty());
  CHECK(issues_of(small_file(Profile::kQuantised, 3000, true)).empty());
}

TEST_CASE("what is there of a truncated file can be read") {
  Scene scene = random_scene(40, 1, 30, 21);
  scene.importance.assign(scene.gaussians.size(), 0.5f);
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    settings.chunk_seconds = 0.2;
    const auto encoded = encode_scene(scene, settings);
    REQUIRE(encoded.ok());
    const Bytes& whole = *encoded;
    const auto sound = SceneReader::open(memory_source(whole));
    REQUIRE(sound.ok());
    REQUIRE((*sound)->segments().size() > 3);
    CHECK((*sound)->damage().empty());
    std::vector<std::vector<float>> positions;
    for (std::uint32_t i = 0; i < (*sound)->segments().size(); ++i) {
      positions.push_back((*sound)->decode(i)->position);
    }
    const std::size_t body = body_at(whole);
    for (std::size_t size = body; size < whole.size(); ++size) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      const auto reader = SceneReader::open(memory_source(cut));
      REQUIRE(reader.ok());
      const auto& segments = (*reader)->segments();
      REQUIRE(segments.size() == positions.size());
      double complete = 30;
      for (std::uint32_t i = 0; i < segments.size(); ++i) {
        const SegmentInfo& s = segments[i];
        const bool there = s.offset + s.bytes <= size;
        const bool all = there && s.harmonics_offset + s.harmonics_bytes <= size;
        if (!all) complete = std::min(complete, s.begin_ticks);
        const auto set = (*reader)->decode(i);
        if (s.there != there || (s.there && s.harmonics_there) != all || set.ok() != all) {
          FAIL(size << " bytes, segment " << i);
        }
        if (!all && set.status().message().find("issue 106") == std::string::npos) {
          FAIL(set.status().message());
        }
        Status lost;
        const auto left = (*reader)->decode_sound(i, lost);
        if (left.ok() != there || (there && lost.ok() != all)) FAIL(size << " bytes: sound " << i);
        if (there && left->position != positions[i]) FAIL("other positions at " << size);
      }
      if ((*reader)->damage().size() != 1 || (*reader)->damage()[0].number != 106 ||
          (*reader)->missing_bytes() != whole.size() - size ||
          (*reader)->complete_ticks() != complete) {
        FAIL(size << " bytes: says otherwise");
      }
      if (numbers_of(issues_of(cut)) != std::set<int>{106}) FAIL(size << " bytes: other issues");
      if (read_all(cut).code() != StatusCode::kInvalidFile) FAIL(size << " bytes: read as whole");
    }
  }
}

TEST_CASE("a file cut anywhere is an error") {
  for (Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const Bytes whole = small_file(profile);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      const Status status = read_all(cut);
      const auto issues = issues_of(cut);
      if (status.code() != StatusCode::kInvalidFile || issues.empty()) {
        FAIL("cut to " << size << " bytes: " << status.message());
      }
    }
  }
}

TEST_CASE("a file with bytes after its end is an error") {
  Bytes bytes = small_file(Profile::kLossless);
  bytes.push_back(0);
  CHECK(read_all(bytes).message().find("bytes after its end") != std::string::npos);
}

TEST_CASE("every changed byte is found, reading and validating") {
  const Bytes files[] = {small_file(Profile::kLossless, 12), small_file(Profile::kQuantised, 12),
                         small_file(Profile::kQuantised, 6, true)};
  for (const Bytes& whole : files) {
    for (std::size_t at = 0; at < whole.size(); ++at) {
      for (int flip : {0x01, 0x10, 0x80, 0xFF}) {
        Bytes damaged = whole;
        damaged[at] = static_cast<std::uint8_t>(damaged[at] ^ flip);
        const Status status = read_all(damaged);
        if (status.ok() || issues_of(damaged).empty()) {
          FAIL("byte " << at << " ^ " << flip << ": " << status.message());
        }
      }
    }
  }
}

TEST_CASE("damage stays within its segment") {
  Bytes bytes = small_file(Profile::kQuantised, 2000);
  const auto sound = SceneReader::open(memory_source(bytes));
  REQUIRE(sound.ok());
  const auto segments = (*sound)->segments();
  REQUIRE(segments.size() > 3);
  const std::size_t at = segments[1].offset + segments[1].bytes / 2;
  bytes[at] ^= 0x40;
  const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
  REQUIRE(reader.ok());
  for (std::uint32_t s = 0; s < segments.size(); ++s) CHECK((*reader)->decode(s).ok() == (s != 1));
  const std::string message = (*reader)->decode(1).status().message();
  CHECK(message == fmt::format("x.stgs: segment 1 is damaged (checksum of {} bytes) (byte {}, "
                               "issue 112)",
                               segments[1].bytes - kRecord, segments[1].offset + kRecord));
  for (const Issue& issue : issues_of(bytes)) {
    CHECK(issue.offset >= segments[1].offset);
    CHECK(issue.offset < segments[1].offset + segments[1].bytes);
  }
}

TEST_CASE("damage to harmonics leaves the primitives without them") {
  Bytes bytes = small_file(Profile::kQuantised, 2000);
  const auto sound = SceneReader::open(memory_source(bytes));
  REQUIRE(sound.ok());
  const SegmentInfo segment = (*sound)->segments()[0];
  REQUIRE(segment.harmonics_bytes > 0);
  bytes[segment.harmonics_offset + segment.harmonics_bytes / 2] ^= 0x40;
  const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
  REQUIRE(reader.ok());
  CHECK((*reader)->decode(0).status().code() == StatusCode::kInvalidFile);
  Status lost;
  const auto set = (*reader)->decode_sound(0, lost);
  REQUIRE(set.ok());
  CHECK(lost.message().find("issue 112") != std::string::npos);
  const auto plain = (*sound)->decode(0, false);
  CHECK(set->sh == plain->sh);
  CHECK(set->position == plain->position);
  REQUIRE((*reader)->decode_sound(1, lost).ok());
  CHECK(lost.ok());
  CHECK(numbers_of(issues_of(bytes)).count(112) == 1);
}

TEST_CASE("the header's fields are checked one by one") {
  const Bytes whole = small_file(Profile::kLossless);
  const auto change = [&](std::size_t at, auto value) {
    Bytes bytes = whole;
    put(bytes, at, value);
    seal_header(bytes);
    return std::make_pair(read_all(bytes), numbers_of(issues_of(bytes)));
  };
  CHECK(read_all({}).message() ==
        "x.stgs: 0 bytes are too few for an .stgs file (byte 0, issue 101)");
  CHECK(change(0, std::uint8_t{0x88}).second == std::set<int>{102});
  CHECK(change(5, std::uint8_t{0x0D}).first.message().find("as text") != std::string::npos);
  CHECK(change(8, std::uint16_t{1}).first.code() == StatusCode::kUnsupported);
  CHECK(change(8, std::uint16_t{1}).second == std::set<int>{104});
  CHECK(change(10, std::uint16_t{9}).first.ok());  // a newer minor version is read
  CHECK(change(10, std::uint16_t{3}).first.code() == StatusCode::kUnsupported);
  CHECK(change(10, std::uint16_t{3}).second == std::set<int>{104});
  CHECK(change(12, std::uint32_t{2}).second == std::set<int>{105});
  CHECK(change(12, std::uint32_t{0x10000}).first.ok());
  CHECK(change(16, std::uint64_t{1} << 60).second.count(106) == 1);
  CHECK(change(24, std::uint64_t{1} << 60).second == std::set<int>{107});
  CHECK(change(24, std::uint64_t{1}).second == std::set<int>{107});
}

TEST_CASE("the metadata's fields are checked one by one") {
  const Bytes whole = small_file(Profile::kLossless);
  const std::size_t at = metadata_at(whole);
  CHECK(first_issue(whole, at, 0, std::uint32_t{0}) == 202);
  CHECK(first_issue(whole, at, 8, std::uint32_t{0}) == 202);
  for (std::size_t field : {13, 14, 15}) {
    CHECK(first_issue(whole, at, field, std::uint8_t{7}) == 201);
  }
  CHECK(first_issue(whole, at, 18, std::uint16_t{4}) == 203);
  CHECK(first_issue(whole, at, 20, NAN) == 204);
  CHECK(first_issue(whole, at, 32, 1e30f) == 204);
  CHECK(first_issue(whole, at, 132, std::uint32_t{0xFFFFFFFF}) == 200);
  CHECK(first_issue(whole, at, 136, std::uint8_t{0xFF}) == 205);
}

TEST_CASE("a start camera must be a camera") {
  Scene scene = random_scene(2, 0, 30, 21);
  StartCamera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 500.0f;
  scene.metadata.start_camera = camera;
  const auto whole = encode_scene(scene, {});
  REQUIRE(whole.ok());
  REQUIRE(issues_of(*whole).empty());
  const std::size_t at = metadata_at(*whole);
  CHECK(first_issue(*whole, at, 60, std::uint32_t{0}) == 204);
  CHECK(first_issue(*whole, at, 60, std::uint32_t{32769}) == 204);
  CHECK(first_issue(*whole, at, 64, ~std::uint32_t{0}) == 204);
  CHECK(first_issue(*whole, at, 68, -1.0f) == 204);  // a mirror
  CHECK(first_issue(*whole, at, 72, 0.01f) == 204);  // a shear
  CHECK(first_issue(*whole, at, 72, 3e38f) == 204);
  CHECK(first_issue(*whole, at, 116, 0.0f) == 204);
}

TEST_CASE("a segment's fields are checked one by one") {
  const Bytes whole = small_file(Profile::kLossless);
  const std::size_t at = body_at(whole);
  CHECK(first_issue(whole, at, 0, std::int16_t{3}) == 400);
  CHECK(first_issue(whole, at, 8, std::uint32_t{5}) == 400);
  CHECK(first_issue(whole, at, 12, std::uint16_t{1}) == 409);
  CHECK(first_issue(whole, at, 12, std::uint16_t{0xFFFE}) == 409);
  CHECK(first_issue(whole, at, 12, std::uint16_t{0xFFFF}) == 409);  // its own, which is not there
  CHECK(first_issue(whole, at, 14, std::uint64_t{0}) == 406);
  CHECK(first_issue(whole, at, 22, ~std::uint64_t{0}) == 401);
  CHECK(first_issue(whole, at, 22, get<std::uint64_t>(whole, at + kRecord + 22) - 1) == 401);
}

TEST_CASE("a layout's fields are checked one by one") {
  const Bytes whole = small_file(Profile::kLossless);
  const std::size_t at = layouts_at(whole), row = 7;
  CHECK(first_issue(whole, at, 0, std::uint16_t{0xFFFF}) == 409);
  CHECK(first_issue(whole, at, 0, std::uint16_t{1024}) == 409);
  CHECK(first_issue(whole, at, 2, std::uint16_t{2}) == 409);
  CHECK(first_issue(whole, at, 2, std::uint16_t{0}) == 409);  // the segments' is missing
  CHECK(first_issue(whole, at, 4, std::uint8_t{8}) == 402);   // streams: two are missing
  CHECK(first_issue(whole, at, row, std::uint16_t{2}) == 404);
  CHECK(first_issue(whole, at, row + 16, std::uint16_t{8}) == 402);
  CHECK(first_issue(whole, at, row, std::uint16_t{0x4000}) == 403);
  CHECK(first_issue(whole, at, row, std::uint16_t{0x8000}) == 402);
  CHECK(first_issue(whole, at, row + 2, std::uint8_t{9}) == 404);
  CHECK(first_issue(whole, at, row + 3, std::uint8_t{200}) == 403);
  CHECK(first_issue(whole, at, row + 3, std::uint8_t{4}) == 404);
  CHECK(first_issue(whole, at, row + 4, std::uint8_t{9}) == 403);
  CHECK(first_issue(whole, at, row + 5, std::uint8_t{9}) == 403);
  CHECK(first_issue(whole, at, row - 2, std::uint16_t{5}) == 409);  // the row's bytes
  CHECK(first_issue(whole, at, row - 2, std::uint16_t{13}) == 409);
  CHECK(first_issue(whole, at, row - 2, std::uint16_t{0xFFFF}) == 409);
  CHECK(first_issue(whole, at, row + 6, std::int8_t{1}) == 404);
  CHECK(first_issue(whole, at, row + 7, std::uint8_t{3}) == 404);
  CHECK(first_issue(whole, at, row + 8, std::uint8_t{0}) == 404);
  CHECK(first_issue(whole, at, row + 8, std::uint8_t{17}) == 404);
  CHECK(first_issue(whole, at, row + 9, std::uint8_t{4}) == 404);
  CHECK(first_issue(whole, at, row + 10, std::uint8_t{7}) == 404);
  CHECK(first_issue(whole, at, row + 10, std::uint8_t{0}) == 404);

  // With rANS; its rows come after its tables.
  const Bytes coded = small_file(Profile::kQuantised, 3000);
  const std::size_t tables_at = layouts_at(coded);
  REQUIRE(get<std::uint16_t>(coded, tables_at + kRecord) > 0);
  CHECK(first_issue(coded, tables_at, 0, std::uint16_t{1025}) == 409);
  CHECK(first_issue(coded, tables_at, 2, std::uint64_t{0}) == 409);  // no table
  // Steps of time so fine that the beginning of a segment is no integer that fits.
  const Bytes time_row = {0x02, 0x00, 0x01, 0x07};
  const auto rows = coded.begin() + static_cast<std::ptrdiff_t>(tables_at + kRecord);
  const auto end = coded.begin() + static_cast<std::ptrdiff_t>(index_at(coded));
  bool found = false;
  for (auto hit = rows; (hit = std::search(hit, end, time_row.begin(), time_row.end())) != end;) {
    Bytes fine = coded;
    put<std::int8_t>(fine, static_cast<std::size_t>(hit - coded.begin()) + 6, -60);
    seal_record(fine, tables_at);
    found |= numbers_of(issues_of(fine)) == std::set<int>{407};
    ++hit;
  }
  CHECK(found);
  Bytes bytes = coded;
  const auto length = get<std::uint64_t>(bytes, tables_at + 8);
  put<std::uint16_t>(bytes, tables_at + kRecord + length - 2, 1023);  // the last plane's table
  seal_record(bytes, tables_at);
  CHECK(numbers_of(issues_of(bytes)).count(409) == 1);
  CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
}

TEST_CASE("values that break the representation are found by the validator") {
  const Bytes whole = small_file(Profile::kLossless);
  const std::size_t at = body_at(whole);
  // Streams of the first segment are stored or packed; a wrong stated chunk or bound needs no
  // decoding to be provoked.
  Bytes bytes = whole;
  put<float>(bytes, metadata_at(bytes) + kRecord + 44, -1e3f);
  put<float>(bytes, metadata_at(bytes) + kRecord + 32, -2e3f);
  seal_record(bytes, metadata_at(bytes));
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{505});
  CHECK(read_all(bytes).ok());  // a warning
  bytes = whole;
  put<double>(bytes, index_at(bytes) + kRecord, 5.0);
  seal_record(bytes, index_at(bytes));
  CHECK(numbers_of(issues_of(bytes)).count(504) == 1);
  REQUIRE(at < whole.size());
}

TEST_CASE("values that cannot be drawn are refused though every checksum is right") {
  // One primitive: all its streams are stored, in the order of their rows.
  auto scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  auto encoded = encode_scene(scene, {});
  REQUIRE(encoded.ok());
  const Bytes whole = *encoded;
  const std::size_t at = body_at(whole), sizes = at + kRecord + 22;
  const auto broken = [&](std::size_t attribute, float value) {
    Bytes bytes = whole;
    const std::size_t first = sizes + std::size_t{9} * 8;
    std::size_t stream = first;
    for (std::size_t i = 0; i < attribute; ++i) {
      stream += get<std::uint64_t>(bytes, sizes + 8 * i);
    }
    const auto size = get<std::uint64_t>(bytes, sizes + 8 * attribute);
    REQUIRE(size % 4 == 0);
    // The planes of the first component: one byte each.
    for (std::size_t c = 0; c < size; c += 4) put<float>(bytes, stream + c, value);
    put<std::uint64_t>(bytes, at + kRecord + 14,
                       XXH3_64bits(bytes.data() + first, bytes.size() - first));
    seal_record(bytes, at);
    CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
    return numbers_of(issues_of(bytes));
  };
  CHECK(broken(0, NAN).count(500) == 1);
  CHECK(broken(5, INFINITY).count(500) == 1);
  CHECK(broken(2, 0.0f).count(501) == 1);
  CHECK(broken(2, -1.0f).count(501) == 1);
  CHECK(broken(3, -1.0f).count(502) == 1);
  CHECK(broken(6, 0.0f).count(503) == 1);
}

namespace {

// One primitive of degree 0: nine streams, all stored.
Bytes one_primitive() {
  auto scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  auto encoded = encode_scene(scene, {});
  REQUIRE(encoded.ok());
  return std::move(*encoded);
}

constexpr std::size_t kStreams = 9, kSizes = 22, kFirstStream = kSizes + 8 * kStreams;
constexpr std::size_t kRows = 7, kRow = 16;  // of a layout that has no tables

// Replaces the bytes of stream `attribute` of that file, and all sizes around them.
void replace_stream(Bytes& bytes, std::size_t attribute, const Bytes& stored) {
  FileHead head = head_of(bytes);
  const std::size_t at = body_at(bytes), sizes = at + kRecord + kSizes;
  std::size_t stream = at + kRecord + kFirstStream;
  for (std::size_t i = 0; i < attribute; ++i) stream += get<std::uint64_t>(bytes, sizes + 8 * i);
  const auto size = get<std::uint64_t>(bytes, sizes + 8 * attribute);
  const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(stream);
  bytes.insert(bytes.erase(begin, begin + static_cast<std::ptrdiff_t>(size)), stored.begin(),
               stored.end());
  put<std::uint64_t>(bytes, sizes + 8 * attribute, stored.size());
  put<std::uint64_t>(bytes, at + 8, bytes.size() - at - kRecord);
  seal_record(bytes, at);
  head.index.segments[0].base.bytes = bytes.size() - at;
  bytes = with_index(bytes, head);
}

// Makes a file of one record claim so many primitives, in the index and in the record.
void claim(Bytes& bytes, std::uint32_t primitives) {
  FileHead head = head_of(bytes);
  REQUIRE(head.index.segments.size() == 1);
  head.index.primitives = head.index.segments[0].base.primitives = primitives;
  bytes = with_index(bytes, head);
  const std::size_t at = body_at(bytes);
  put<std::uint32_t>(bytes, at + kRecord + 8, primitives);
  seal_record(bytes, at);
}

// A zstd frame of one raw block that states `size` bytes of content.
Bytes zstd_frame(std::uint32_t size, const Bytes& content) {
  Bytes out(12 + content.size());
  put<std::uint32_t>(out, 0, 0xFD2FB528);
  put<std::uint8_t>(out, 4, 0xA0);  // one segment, size in four bytes
  put<std::uint32_t>(out, 5, size);
  const auto block = static_cast<std::uint32_t>(content.size() << 3 | 1);  // raw, the last
  for (std::size_t i = 0; i < 3; ++i) out[9 + i] = static_cast<std::uint8_t>(block >> (8 * i));
  std::copy(content.begin(), content.end(), out.begin() + 12);
  return out;
}

long peak_kib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

}  // namespace

TEST_CASE("a zstd stream is one frame") {
  const Bytes whole = one_primitive();
  const Bytes content(whole.end() - 12, whole.end());  // sh0, the last stream
  Bytes bytes = whole;
  replace_stream(bytes, 8, zstd_frame(12, content));
  CHECK(issues_of(bytes).empty());
  Bytes frames = zstd_frame(12, content);
  const Bytes empty = zstd_frame(0, {});
  frames.insert(frames.end(), empty.begin(), empty.end());
  bytes = whole;
  replace_stream(bytes, 8, frames);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{405});
  CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
}

TEST_CASE("a segment's memory is not allocated before its streams can fill it") {
  constexpr std::uint32_t kClaim = 3'000'000;  // 240 MB of floats
  const Bytes filler(kClaim / 16);             // so many primitives need as many bytes
  const auto check = [](const Bytes& bytes) {
    const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
    REQUIRE(reader.ok());
    const long before = peak_kib();
    const Status status = (*reader)->decode(0).status();
    CHECK(status.message().find("issue 405") != std::string::npos);
    CHECK(numbers_of(issues_of(bytes)) == std::set<int>{405});
    CHECK(peak_kib() - before < 64 * 1024);
  };
  for (bool lying_frames : {false, true}) {
    Bytes bytes = one_primitive();
    for (std::size_t i = 0; lying_frames && i < kStreams; ++i) {
      const std::size_t row = layouts_at(bytes) + kRecord + kRows + kRow * i;
      const auto planes = get<std::uint8_t>(bytes, row + 2) * get<std::uint8_t>(bytes, row + 8);
      replace_stream(bytes, i,
                     zstd_frame(kClaim * static_cast<std::uint32_t>(planes),
                                i == 0 ? filler : Bytes{1, 2, 3}));
    }
    if (!lying_frames) replace_stream(bytes, 0, filler);
    claim(bytes, kClaim);
    check(bytes);
  }
  // Planes of one symbol take no bits, but each block of 2048 primitives has its lanes' states.
  Scene scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  const std::vector<std::uint32_t> copies(10000, 0);
  scene.gaussians = scene.gaussians.gather(copies);
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  auto constant = encode_scene(scene, settings);
  REQUIRE(constant.ok());
  CHECK(issues_of(*constant).empty());
  CHECK(constant->size() < 2500);
  const auto record = static_cast<std::uint32_t>(constant->size() - body_at(*constant));
  claim(*constant, 16 * record);
  check(*constant);
  claim(*constant, 16 * record + 1);
  CHECK(numbers_of(issues_of(*constant)) == std::set<int>{305});
}

TEST_CASE("primitives that are all alike keep the bytes that their number needs") {
  Scene scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  scene.gaussians = scene.gaussians.gather(std::vector<std::uint32_t>(200'000, 0));
  for (const SceneCoder coder : {SceneCoder::kRans, SceneCoder::kZstd}) {
    for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
      WriteSettings settings;
      settings.profile = profile;
      settings.coder = coder;
      const auto bytes = encode_scene(scene, settings);
      REQUIRE(bytes.ok());
      CHECK(issues_of(*bytes).empty());
      CHECK(read_all(*bytes).ok());
    }
  }
}

TEST_CASE("all that decoding a segment takes counts") {
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    for (const bool own_layouts : {false, true}) {
      const Bytes bytes = small_file(profile, 40, own_layouts);
      const auto fits = [&](std::uint64_t limit) {
        const auto reader = SceneReader::open(memory_source(bytes), {1000, limit});
        bool all = reader.ok();
        for (std::uint32_t i = 0; all && i < (*reader)->segments().size(); ++i) {
          const Status status = (*reader)->decode(i).status();
          all = status.ok();
          if (!all && status.code() != StatusCode::kUnsupported) FAIL(status.message());
        }
        return all;
      };
      const auto reader = SceneReader::open(memory_source(bytes));
      REQUIRE(reader.ok());
      std::uint64_t floats = 0, stored = 0;
      for (const SegmentInfo& segment : (*reader)->segments()) {
        floats = std::max<std::uint64_t>(floats, segment.primitives * std::uint64_t{4 * (17 + 12)});
        stored = std::max(stored, segment.bytes + segment.harmonics_bytes);
      }
      CHECK_FALSE(fits(floats));
      CHECK_FALSE(fits(std::max(floats, stored) + 8));
      CHECK(fits(2 * floats + stored + (std::uint64_t{2048} << 14)));
    }
  }
}

TEST_CASE("the flags of META, LAYT, INDX and SEGM are looked at") {
  const Bytes whole = small_file(Profile::kLossless);
  const auto with_flags = [&](std::size_t at, std::uint32_t flags) {
    Bytes bytes = whole;
    put<std::uint32_t>(bytes, at + 4, flags);
    seal_record(bytes, at);
    return std::make_pair(read_all(bytes).code(), numbers_of(issues_of(bytes)));
  };
  const auto not_critical = std::make_pair(StatusCode::kInvalidFile, std::set<int>{116});
  const auto unknown = std::make_pair(StatusCode::kUnsupported, std::set<int>{113});
  for (std::size_t at : {metadata_at(whole), index_at(whole), body_at(whole)}) {
    CHECK(with_flags(at, 0) == not_critical);
    CHECK(with_flags(at, 3) == unknown);
    CHECK(with_flags(at, 0x80000001) == unknown);
  }
  CHECK(with_flags(layouts_at(whole), 0).second == std::set<int>{116, 409});  // and none is left
  CHECK(with_flags(layouts_at(whole), 3).first == StatusCode::kUnsupported);
  CHECK(with_flags(body_at(whole), 2) == not_critical);  // listed, so it cannot be skipped
  CHECK(with_flags(metadata_at(whole), 2).second == std::set<int>{115});
}

TEST_CASE("the flags of a segment that the index does not list are looked at") {
  const Bytes whole = small_file(Profile::kLossless);
  for (std::uint32_t flags : {0u, 1u, 2u, 3u}) {
    Bytes extra(kRecord + 16, 0);
    std::memcpy(extra.data(), "SEGM", 4);
    put<std::uint32_t>(extra, 4, flags);
    put<std::uint64_t>(extra, 8, 16);
    seal_record(extra, 0);
    Bytes bytes = whole;
    bytes.insert(bytes.end(), extra.begin(), extra.end());
    put<std::uint64_t>(bytes, 16, bytes.size());
    seal_header(bytes);
    const std::set<int> expected[] = {{116}, {310}, {}, {113}};
    CHECK(numbers_of(issues_of(bytes)) == expected[flags]);
  }
}

TEST_CASE("unknown records are skipped unless they are critical") {
  const Bytes whole = small_file(Profile::kLossless);
  for (std::uint32_t critical : {0u, 1u}) {
    Bytes extra(kRecord + 5, 0x55);
    std::memcpy(extra.data(), "NOTE", 4);
    put<std::uint32_t>(extra, 4, critical);
    put<std::uint64_t>(extra, 8, 5);
    seal_record(extra, 0);
    // After the last segment.
    Bytes bytes = whole;
    bytes.insert(bytes.end(), extra.begin(), extra.end());
    put<std::uint64_t>(bytes, 16, bytes.size());
    seal_header(bytes);
    CHECK(issues_of(bytes).empty() == (critical == 0));
    CHECK(read_all(bytes).ok());
    // In the head, before META.
    bytes = whole;
    bytes.insert(bytes.begin() + kHeader, extra.begin(), extra.end());
    put<std::uint64_t>(bytes, 16, bytes.size());
    put<std::uint64_t>(bytes, 24, body_at(whole) + extra.size());
    seal_header(bytes);
    const Status status = read_all(bytes);
    CHECK(status.code() == (critical == 0 ? StatusCode::kOk : StatusCode::kUnsupported));
    CHECK(numbers_of(issues_of(bytes)) == (critical == 0 ? std::set<int>{} : std::set<int>{113}));
  }
}

TEST_CASE("the validator goes on after the first finding") {
  Bytes bytes = small_file(Profile::kQuantised, 2000);
  const auto segments = (*SceneReader::open(memory_source(bytes)))->segments();
  REQUIRE(segments.size() > 4);
  for (std::size_t s : {std::size_t{0}, std::size_t{2}, segments.size() - 1}) {
    bytes[segments[s].offset + segments[s].bytes - 1] ^= 1;
  }
  std::size_t damaged = 0;
  for (const Issue& issue : issues_of(bytes)) damaged += issue.number == 112 ? 1 : 0;
  CHECK(damaged == 3);
}

TEST_CASE("random bytes and random changes with right checksums never crash a reader") {
  std::mt19937 random(77);
  const Bytes whole = small_file(Profile::kQuantised, 60);
  const auto segments = (*SceneReader::open(memory_source(whole)))->segments();
  ReadLimits limits;
  limits.max_memory = 1 << 24;
  for (int trial = 0; trial < 3000; ++trial) {
    Bytes bytes = whole;
    const std::size_t s = random() % segments.size();
    const bool layouts = trial % 3 == 0;
    const std::size_t record = layouts ? layouts_at(whole) : segments[s].offset;
    const auto payload = get<std::uint64_t>(whole, record + 8);
    for (int change = 0; change < 3; ++change) {
      bytes[record + kRecord + random() % payload] = static_cast<std::uint8_t>(random());
    }
    seal_record(bytes, record);
    const auto result = read_scene(memory_source(bytes), limits);
    (void)result;
    const auto issues = validate_scene(*memory_source(bytes), limits);
    REQUIRE(issues.ok());
  }
}
