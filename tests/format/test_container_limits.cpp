// SPDX-License-Identifier: Apache-2.0
// Bounds on the memory that malicious files make a reader allocate.
#include <sys/resource.h>

#include <algorithm>
#include <limits>
#include <memory_resource>
#include <set>

#include "catch.h"
#include "damage_fixture.h"
#include "head_fixture.h"
#include "stgs/format/damage_report.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

// One primitive of SH degree 0: nine streams, all stored.
Bytes one_primitive() {
  auto scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  WriteSettings settings;
  settings.coder = SceneCoder::kBytes;
  auto encoded = encode_scene(scene, settings);
  REQUIRE(encoded.ok());
  return without_copy(std::move(*encoded));
}

constexpr std::size_t kStreams = 9, kSizes = 14, kFirstStream = kSizes + 4 * kStreams;

// Replaces the bytes of stream `attribute` in the file of one_primitive(), and all affected sizes.
void replace_stream(Bytes& bytes, std::size_t attribute, const Bytes& stored) {
  FileHead head = head_of(bytes);
  const std::size_t at = body_at(bytes), sizes = at + kRecord + kSizes;
  std::size_t stream = at + kRecord + kFirstStream;
  for (std::size_t i = 0; i < attribute; ++i) stream += get<std::uint32_t>(bytes, sizes + 4 * i);
  const auto size = get<std::uint32_t>(bytes, sizes + 4 * attribute);
  const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(stream);
  bytes.insert(bytes.erase(begin, begin + static_cast<std::ptrdiff_t>(size)), stored.begin(),
               stored.end());
  put<std::uint32_t>(bytes, sizes + 4 * attribute, static_cast<std::uint32_t>(stored.size()));
  put<std::uint64_t>(bytes, at + 8, bytes.size() - at - kRecord);
  seal_record(bytes, at);
  head.index.segments[0].base.bytes = bytes.size() - at;
  bytes = with_index(bytes, head);
}

// Makes a file of one segment state this many primitives, in the index and in the record.
void state_count(Bytes& bytes, std::uint32_t primitives) {
  FileHead head = head_of(bytes);
  REQUIRE(head.index.segments.size() == 1);
  head.index.primitives = head.index.segments[0].base.primitives = primitives;
  bytes = with_index(bytes, head);
  const std::size_t at = body_at(bytes);
  put<std::uint32_t>(bytes, at + kRecord + 8, primitives);
  seal_record(bytes, at);
}

long peak_kib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

// Records the peak of allocated bytes.
class CountingResource final : public std::pmr::memory_resource {
 public:
  std::uint64_t peak = 0;

 private:
  void* do_allocate(std::size_t bytes, std::size_t alignment) override {
    allocated_ += bytes;
    peak = std::max(peak, allocated_);
    return std::pmr::new_delete_resource()->allocate(bytes, alignment);
  }
  void do_deallocate(void* memory, std::size_t bytes, std::size_t alignment) override {
    allocated_ -= bytes;
    std::pmr::new_delete_resource()->deallocate(memory, bytes, alignment);
  }
  bool do_is_equal(const memory_resource& other) const noexcept override { return this == &other; }
  std::uint64_t allocated_ = 0;
};

// A file of one segment that states this many primitives. Its record is zeros or missing.
Bytes file_stating(std::uint32_t primitives, bool has_record) {
  FileHead head;
  head.index.primitives = primitives;
  head.parts.push_back({0, 0, 30, {0, 30}, 1});
  const std::uint64_t bytes = primitives / kMaxPrimitivesPerByte + kRecordHeaderBytes;
  head.index.segments.push_back({{{0, bytes}, -1, 0, 0, primitives}, {}, 0});
  Bytes file = file_with(head, 30, Bytes(bytes));
  if (!has_record) file.resize(file.size() - bytes);
  return file;
}

}  // namespace

TEST_CASE("a stream has exactly the bytes of its planes") {
  const Bytes original = one_primitive();
  const Bytes content(original.end() - 12, original.end());  // sh0, the last stream
  Bytes bytes = original;
  replace_stream(bytes, 8, content);
  CHECK(issues_of(bytes).empty());
  for (const std::size_t size : {std::size_t{11}, std::size_t{13}}) {
    Bytes other = content;
    other.resize(size);
    bytes = original;
    replace_stream(bytes, 8, other);
    CHECK(numbers_of(issues_of(bytes)) == std::set<int>{405});
    CHECK(read_all(bytes).code() == StatusCode::kInvalidFile);
  }
}

TEST_CASE("a segment's memory is allocated only after its streams can fill it") {
  constexpr std::uint32_t kStated = 3'000'000;  // 240 MB of floats
  Bytes bytes = one_primitive();
  replace_stream(bytes, 0, Bytes(kStated));  // the least number of bytes for this many primitives
  state_count(bytes, kStated);
  const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
  REQUIRE(reader.ok());
  const long before = peak_kib();
  const Status status = (*reader)->decode(0).status();
  CHECK(status.message().find("issue 405") != std::string::npos);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{405});
  CHECK(peak_kib() - before < 64 * 1024);
}

TEST_CASE("a record has a byte for each primitive, also if its planes take none") {
  Scene scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  const std::vector<std::uint32_t> copies(10000, 0);
  scene.gaussians = scene.gaussians.gather(copies);
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  settings.tiers = 1;
  const auto encoded = encode_scene(scene, settings);
  REQUIRE(encoded.ok());
  CHECK(issues_of(*encoded).empty());
  Bytes constant = without_copy(*encoded);
  const auto payload = static_cast<std::uint32_t>(constant.size() - body_at(constant) - kRecord);
  CHECK(payload == 10000);
  state_count(constant, payload + 1);
  CHECK(numbers_of(issues_of(constant)) == std::set<int>{305});
}

TEST_CASE("a segment of identical primitives has at least the bytes that its count requires") {
  Scene scene = random_scene(1, 0, 30, 21);
  scene.gaussians.opacity_logit[0] = 3.0f;
  scene.gaussians = scene.gaussians.gather(std::vector<std::uint32_t>(200'000, 0));
  for (const SceneCoder coder : {SceneCoder::kRans, SceneCoder::kBytes}) {
    for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
      WriteSettings settings;
      settings.profile = profile;
      settings.coder = coder;
      const auto bytes = encode_scene(scene, settings);
      REQUIRE(bytes.ok());
      // A validator decodes fewer for so few bytes.
      ReadLimits all;
      all.max_values = std::numeric_limits<std::uint64_t>::max();
      const auto issues = validate_scene(*memory_source(*bytes), all);
      REQUIRE(issues.ok());
      CHECK(issues->empty());
      CHECK(read_all(*bytes).ok());
    }
  }
}

TEST_CASE("the memory limit covers everything that decoding a segment allocates") {
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
        stored = std::max(stored, segment.bytes + segment.sh_bytes);
      }
      CHECK_FALSE(fits(floats));
      CHECK_FALSE(fits(std::max(floats, stored) + 8));
      CHECK(fits(2 * floats + stored + (std::uint64_t{2048} << 14)));
    }
  }
}

TEST_CASE("memory is allocated for decoded primitives, not for the count in the index") {
  CountingResource heap;
  std::pmr::memory_resource* const before = std::pmr::set_default_resource(&heap);
  for (const bool has_record : {false, true}) {
    DamageReport report;
    const auto scene = recover_scene(memory_source(file_stating(1'000'000, has_record)), report);
    CHECK(scene.status().code() == StatusCode::kInvalidFile);
  }
  std::pmr::set_default_resource(before);
  CHECK(heap.peak < 10'000);
}

TEST_CASE("index entries and layout rows count towards the memory limit") {
  const auto opening = [](const Bytes& bytes, std::uint64_t limit) {
    ReadLimits limits;
    limits.max_memory = limit;
    return SceneReader::open(memory_source(bytes), limits).status();
  };
  FileHead head;
  constexpr std::uint32_t kParts = 600;  // one segment each
  constexpr std::uint64_t kBytes = kRecordHeaderBytes + 1;
  head.index.primitives = kParts;
  for (std::uint32_t i = 0; i < kParts; ++i) {
    head.parts.push_back({i, 0, 30, {0, 30}, 1});
    head.index.segments.push_back({{{0, kBytes}, -1, 0, 0, 1}, {}, i});
  }
  const Bytes many = file_with(head, 30, Bytes(kParts * kBytes));
  FileMetadata metadata;
  metadata.scene.frames = 30;
  const Bytes meta = write_record(kMetadataTag, write_metadata(metadata));
  constexpr std::uint64_t kNeeded = (2 * kParts - 1024) * 512;
  CHECK(opening(many, kNeeded).ok());
  const Status rejected = opening(many, kNeeded - 1);
  CHECK(rejected.code() == StatusCode::kUnsupported);
  CHECK(rejected.message().find("issue 308") != std::string::npos);

  // 10 layouts of 255 rows of an unknown attribute: 2560 entries.
  ByteWriter rows;
  rows.u16(0);
  rows.u16(10);
  for (int layout = 0; layout < 10; ++layout) {
    rows.u8(255);
    for (int row = 0; row < 255; ++row) {
      rows.u16(6);
      rows.u16(0x8000);
      rows.u32(1);
    }
  }
  const Bytes layouts = write_record(kLayoutTag, rows.take());
  const Bytes one = write_record(kIndexTag, write_index({}, {}));
  const Bytes wide = file_of({meta, layouts, one});
  CHECK(opening(wide, (2560 - 1024) * 128).ok());
  CHECK(opening(wide, (2560 - 1024) * 128 - 1).code() == StatusCode::kUnsupported);
}
