// SPDX-License-Identifier: Apache-2.0
// A flipped bit anywhere in a file is detected, and the undamaged segments still decode.
#include "catch.h"
#include "fixtures/copy_fixture.h"
#include "fixtures/recording_fixture.h"

using namespace stgs;
using stgs::testing::fingerprints;
using Bytes = std::vector<std::uint8_t>;

namespace {

// Several segments and tiers, SH in separate records if the profile has them, importances.
Bytes small_file(Profile profile) {
  Scene scene = testing::random_scene(24, 1, 30, 21);
  if (profile == Profile::kLossless) scene.importance.assign(24, 1.0f);
  WriteSettings settings;
  settings.profile = profile;
  settings.tiers = 2;
  settings.chunk_seconds = 0.2;
  auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  return std::move(*bytes);
}

// The decoded primitives of each segment, with and without SH; empty if it is damaged.
struct Decoded {
  std::vector<std::vector<std::string>> with_sh, base;
};
Decoded decode_all(const SceneReader& reader) {
  Decoded out;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    const auto with_sh = reader.decode(s), base = reader.decode(s, false);
    out.with_sh.push_back(with_sh.ok() ? fingerprints(*with_sh) : std::vector<std::string>{});
    out.base.push_back(base.ok() ? fingerprints(*base) : std::vector<std::string>{});
  }
  return out;
}

bool within(std::uint64_t at, std::uint64_t begin, std::uint64_t bytes) {
  return at >= begin && at - begin < bytes;
}

void flip_each_byte(Profile profile) {
  const Bytes intact = small_file(profile);
  const auto intact_reader = SceneReader::open(memory_source(intact));
  REQUIRE(intact_reader.ok());
  const std::vector<SegmentInfo> segments = (*intact_reader)->segments();
  REQUIRE(segments.size() > 3);
  const Decoded expected = decode_all(**intact_reader);
  std::uint64_t body = intact.size();
  for (const SegmentInfo& segment : segments) body = std::min(body, segment.offset);
  const std::size_t copy = stgs::testing::copy_at(intact);
  const bool has_importance = !(*intact_reader)->importance()->empty();
  REQUIRE(copy < intact.size());
  for (std::size_t at = 0; at < intact.size(); ++at) {
    Bytes bytes = intact;
    bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << (5 * at + at / 8) % 8);
    INFO("byte " << at << " of " << bytes.size());
    const auto issues = validate_scene(*memory_source(bytes, "x.stgs"));
    REQUIRE(issues.ok());
    REQUIRE_FALSE(issues->empty());
    const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
    REQUIRE(reader.ok());
    REQUIRE((*reader)->damage().empty() == (at >= body));
    const bool is_repairable = at < body || at >= copy;
    // Without earlier importances, a record with a damaged header could be the one that has them.
    const bool is_readable =
        is_repairable && (has_importance || !within(at, copy, testing::kRecord));
    REQUIRE(read_scene(memory_source(bytes, "x.stgs")).ok() == is_readable);
    const Decoded decoded = decode_all(**reader);
    if (is_repairable) {
      REQUIRE(decoded.with_sh == expected.with_sh);
      if (is_readable) REQUIRE(*(*reader)->importance() == *(*intact_reader)->importance());
      continue;
    }
    bool in_segment = false;
    for (std::size_t s = 0; s < segments.size(); ++s) {
      const SegmentInfo& segment = segments[s];
      const bool base = within(at, segment.offset, segment.bytes);
      const bool sh = within(at, segment.sh_offset, segment.sh_bytes);
      in_segment = in_segment || base || sh;
      REQUIRE(decoded.base[s] == (base ? std::vector<std::string>{} : expected.base[s]));
      REQUIRE(decoded.with_sh[s] ==
              (base || sh ? std::vector<std::string>{} : expected.with_sh[s]));
    }
    REQUIRE(in_segment == (*reader)->importance().ok());
  }
}

}  // namespace

TEST_CASE("a flipped bit in a recording's head is detected, and every fragment decodes") {
  const std::pair<std::uint32_t, bool> kinds[] = {{1, false}, {5, false}, {5, true}};
  for (const auto& [count, close] : kinds) {
    const testing::TemporaryFolder folder;
    const std::string path = folder / "live.stgs";
    const auto sizes = testing::record(path, count, close);
    const Bytes intact = testing::bytes_of(path);
    const auto intact_reader = SceneReader::open(memory_source(intact));
    REQUIRE(intact_reader.ok());
    const Decoded expected = decode_all(**intact_reader);
    REQUIRE((*intact_reader)->segments().size() >= count);
    for (std::size_t at = 0; at < sizes.front(); ++at) {
      Bytes bytes = intact;
      bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << (5 * at + at / 8) % 8);
      INFO("byte " << at << " of " << sizes.front());
      REQUIRE_FALSE(testing::issues_of(bytes).empty());
      const auto reader = SceneReader::open(memory_source(bytes));
      REQUIRE(reader.ok());
      REQUIRE((*reader)->form() == (*intact_reader)->form());
      REQUIRE(decode_all(**reader).with_sh == expected.with_sh);
    }
  }
}

TEST_CASE("a flipped bit is detected at any offset, and the other segments decode") {
  flip_each_byte(Profile::kLossless);
  flip_each_byte(Profile::kQuantised);
  if (check_profile(Profile::kDraco).ok()) flip_each_byte(Profile::kDraco);
}
