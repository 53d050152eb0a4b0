// SPDX-License-Identifier: Apache-2.0
// How the reader and the validator report damaged files.
#include <algorithm>
#include <set>

#include "catch.h"
#include "damage_fixture.h"

using namespace stgs;
using namespace stgs::testing;

TEST_CASE("an undamaged file has no issues") {
  CHECK(issues_of(small_file(Profile::kLossless)).empty());
  CHECK(issues_of(small_file(Profile::kQuantised)).empty());
  CHECK(issues_of(small_file(Profile::kQuantised, 3000)).empty());
  CHECK(issues_of(small_file(Profile::kLossless, 40, true)).empty());
  CHECK(issues_of(small_file(Profile::kQuantised, 3000, true)).empty());
}

TEST_CASE("the complete segments of a truncated file can be read") {
  Scene scene = random_scene(40, 1, 30, 21);
  scene.importance.assign(scene.gaussians.size(), 0.5f);
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    settings.chunk_seconds = 0.2;
    const auto encoded = encode_scene(scene, settings);
    REQUIRE(encoded.ok());
    const Bytes original = without_copy(*encoded);
    const auto intact = SceneReader::open(memory_source(original));
    REQUIRE(intact.ok());
    REQUIRE((*intact)->segments().size() > 3);
    CHECK((*intact)->damage().empty());
    std::vector<FloatArray> positions;
    for (std::uint32_t i = 0; i < (*intact)->segments().size(); ++i) {
      positions.push_back((*intact)->decode(i)->position);
    }
    const std::size_t body = body_at(original);
    for (std::size_t size = body; size < original.size(); ++size) {
      const Bytes cut(original.begin(), original.begin() + static_cast<std::ptrdiff_t>(size));
      const auto reader = SceneReader::open(memory_source(cut));
      REQUIRE(reader.ok());
      const auto& segments = (*reader)->segments();
      REQUIRE(segments.size() == positions.size());
      double complete = 30;
      for (std::uint32_t i = 0; i < segments.size(); ++i) {
        const SegmentInfo& s = segments[i];
        const bool available = s.offset + s.bytes <= size;
        const bool all = available && s.sh_offset + s.sh_bytes <= size;
        if (!all) complete = std::min(complete, s.begin_ticks);
        const auto set = (*reader)->decode(i);
        if (s.available != available || (s.available && s.sh_available) != all || set.ok() != all) {
          FAIL(size << " bytes, segment " << i);
        }
        if (!all && set.status().message().find("issue 106") == std::string::npos) {
          FAIL(set.status().message());
        }
        Status damage;
        const auto recovered = (*reader)->decode_intact(i, damage);
        if (recovered.ok() != available || (available && damage.ok() != all))
          FAIL(size << " bytes: decode_intact of segment " << i);
        if (available && recovered->position != positions[i])
          FAIL(size << " bytes: positions differ in segment " << i);
      }
      if ((*reader)->damage().size() != 1 || (*reader)->damage()[0].number != 106 ||
          (*reader)->missing_bytes() != original.size() - size ||
          (*reader)->complete_ticks() != complete) {
        FAIL(size << " bytes: wrong damage report");
      }
      if (numbers_of(issues_of(cut)) != std::set<int>{106}) FAIL(size << " bytes: wrong issues");
      if (read_all(cut).code() != StatusCode::kInvalidFile)
        FAIL(size << " bytes: read without an error");
    }
  }
}

TEST_CASE("a file truncated at any byte is an error") {
  for (Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    const Bytes original = small_file(profile);
    for (std::size_t size = 0; size < original.size(); ++size) {
      const Bytes cut(original.begin(), original.begin() + static_cast<std::ptrdiff_t>(size));
      const Status status = read_all(cut);
      const auto issues = issues_of(cut);
      if (status.code() != StatusCode::kInvalidFile || issues.empty()) {
        FAIL("cut to " << size << " bytes: " << status.message());
      }
    }
  }
}

TEST_CASE("a file with trailing bytes is read, and the bytes are reported") {
  Bytes bytes = small_file(Profile::kLossless);
  bytes.push_back(0);
  CHECK(read_all(bytes).ok());
  CHECK((*SceneReader::open(memory_source(bytes)))
            ->damage()[0]
            .message.find("after the end of the file") != std::string::npos);
  CHECK(numbers_of(issues_of(bytes)) == std::set<int>{106});
}

TEST_CASE("the reader and the validator detect every changed byte") {
  const Bytes files[] = {small_file(Profile::kLossless, 12), small_file(Profile::kQuantised, 12),
                         small_file(Profile::kQuantised, 6, true)};
  for (const Bytes& original : files) {
    for (std::size_t at = 0; at < original.size(); ++at) {
      for (int flip : {0x01, 0x10, 0x80, 0xFF}) {
        Bytes damaged = original;
        damaged[at] = static_cast<std::uint8_t>(damaged[at] ^ flip);
        const Status status = read_all(damaged);
        // A reader continues without a record of the head that is not critical, and reports it.
        bool reported = !status.ok();
        if (status.ok()) {
          const auto reader = SceneReader::open(memory_source(damaged));
          REQUIRE(reader.ok());
          reported = !(*reader)->damage().empty() && (*reader)->error_bounds().empty();
        }
        if (!reported || issues_of(damaged).empty()) {
          FAIL("byte " << at << " ^ " << flip << ": " << status.message());
        }
      }
    }
  }
}

TEST_CASE("damage is confined to its segment") {
  Bytes bytes = small_file(Profile::kQuantised, 2000);
  const auto intact = SceneReader::open(memory_source(bytes));
  REQUIRE(intact.ok());
  const auto segments = (*intact)->segments();
  REQUIRE(segments.size() > 3);
  const std::size_t at = segments[1].offset + segments[1].bytes / 2;
  bytes[at] ^= 0x40;
  const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
  REQUIRE(reader.ok());
  for (std::uint32_t s = 0; s < segments.size(); ++s) CHECK((*reader)->decode(s).ok() == (s != 1));
  const std::string message = (*reader)->decode(1).status().message();
  CHECK(message ==
        fmt::format("x.stgs: segment 1 is damaged (checksum mismatch over {} bytes) (byte {}, "
                    "issue 112)",
                    segments[1].bytes - kRecord, segments[1].offset + kRecord));
  for (const Issue& issue : issues_of(bytes)) {
    CHECK(issue.offset >= segments[1].offset);
    CHECK(issue.offset < segments[1].offset + segments[1].bytes);
  }
}

TEST_CASE("damaged SH leave the primitives without SH") {
  Bytes bytes = small_file(Profile::kQuantised, 2000);
  const auto intact = SceneReader::open(memory_source(bytes));
  REQUIRE(intact.ok());
  const SegmentInfo segment = (*intact)->segments()[0];
  REQUIRE(segment.sh_bytes > 0);
  bytes[segment.sh_offset + segment.sh_bytes / 2] ^= 0x40;
  const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
  REQUIRE(reader.ok());
  CHECK((*reader)->decode(0).status().code() == StatusCode::kInvalidFile);
  Status damage;
  const auto set = (*reader)->decode_intact(0, damage);
  REQUIRE(set.ok());
  CHECK(damage.message().find("issue 112") != std::string::npos);
  const auto plain = (*intact)->decode(0, false);
  CHECK(set->sh == plain->sh);
  CHECK(set->position == plain->position);
  REQUIRE((*reader)->decode_intact(1, damage).ok());
  CHECK(damage.ok());
  CHECK(numbers_of(issues_of(bytes)).count(112) == 1);
}

TEST_CASE("the validator continues after the first finding") {
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

TEST_CASE("random changes under valid checksums never crash the reader") {
  std::mt19937 random(77);
  const Bytes original = small_file(Profile::kQuantised, 60);
  const auto segments = (*SceneReader::open(memory_source(original)))->segments();
  ReadLimits limits;
  limits.max_memory = 1 << 24;
  for (int trial = 0; trial < 3000; ++trial) {
    Bytes bytes = original;
    const std::size_t s = random() % segments.size();
    const bool layouts = trial % 3 == 0;
    const std::size_t record = layouts ? layouts_at(original) : segments[s].offset;
    const auto payload = get<std::uint64_t>(original, record + 8);
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
