// SPDX-License-Identifier: Apache-2.0
// A bit that flips anywhere in a file is found, and what it does not touch still plays.
#include "catch.h"
#include "copy_fixture.h"
#include "recording_fixture.h"

using namespace stgs;
using stgs::testing::fingerprints;
using Bytes = std::vector<std::uint8_t>;

namespace {

// Several segments and tiers, harmonics apart where the profile has them, importances.
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

// What a player gets of each segment, "" for nothing: with its harmonics, and without.
struct Played {
  std::vector<std::vector<std::string>> whole, base;
};
Played play(const SceneReader& reader) {
  Played out;
  for (std::uint32_t s = 0; s < reader.segments().size(); ++s) {
    const auto whole = reader.decode(s), base = reader.decode(s, false);
    out.whole.push_back(whole.ok() ? fingerprints(*whole) : std::vector<std::string>{});
    out.base.push_back(base.ok() ? fingerprints(*base) : std::vector<std::string>{});
  }
  return out;
}

bool within(std::uint64_t at, std::uint64_t begin, std::uint64_t bytes) {
  return at >= begin && at - begin < bytes;
}

void flip_each_byte(Profile profile) {
  const Bytes sound = small_file(profile);
  const auto sound_reader = SceneReader::open(memory_source(sound));
  REQUIRE(sound_reader.ok());
  const std::vector<SegmentInfo> segments = (*sound_reader)->segments();
  REQUIRE(segments.size() > 3);
  const Played expected = play(**sound_reader);
  std::uint64_t body = sound.size();
  for (const SegmentInfo& segment : segments) body = std::min(body, segment.offset);
  const std::size_t copy = stgs::testing::copy_at(sound);
  const bool has_importance = !(*sound_reader)->importance()->empty();
  REQUIRE(copy < sound.size());
  for (std::size_t at = 0; at < sound.size(); ++at) {
    Bytes bytes = sound;
    bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << (5 * at + at / 8) % 8);
    INFO("byte " << at << " of " << bytes.size());
    const auto issues = validate_scene(*memory_source(bytes, "x.stgs"));
    REQUIRE(issues.ok());
    REQUIRE_FALSE(issues->empty());
    const auto reader = SceneReader::open(memory_source(bytes, "x.stgs"));
    REQUIRE(reader.ok());
    REQUIRE((*reader)->damage().empty() == (at >= body));
    const bool nothing_lost = at < body || at >= copy;
    // Where no importances come before, a record whose header is damaged may have them.
    const bool told = nothing_lost && (has_importance || !within(at, copy, 32));
    REQUIRE(read_scene(memory_source(bytes, "x.stgs")).ok() == told);
    const Played played = play(**reader);
    if (nothing_lost) {
      REQUIRE(played.whole == expected.whole);
      if (told) REQUIRE(*(*reader)->importance() == *(*sound_reader)->importance());
      continue;
    }
    bool in_a_segment = false;
    for (std::size_t s = 0; s < segments.size(); ++s) {
      const SegmentInfo& segment = segments[s];
      const bool base = within(at, segment.offset, segment.bytes);
      const bool harmonics = within(at, segment.sh_offset, segment.sh_bytes);
      in_a_segment = in_a_segment || base || harmonics;
      REQUIRE(played.base[s] == (base ? std::vector<std::string>{} : expected.base[s]));
      REQUIRE(played.whole[s] ==
              (base || harmonics ? std::vector<std::string>{} : expected.whole[s]));
    }
    REQUIRE(in_a_segment == (*reader)->importance().ok());
  }
}

}  // namespace

TEST_CASE("a flipped bit before a recording's first stretch is found, and all of it plays") {
  const std::pair<std::uint32_t, bool> kinds[] = {{1, false}, {5, false}, {5, true}};
  for (const auto& [stretches, close] : kinds) {
    const testing::TemporaryFolder folder;
    const std::string path = folder / "live.stgs";
    const auto sizes = testing::record(path, stretches, close);
    const Bytes sound = testing::bytes_of(path);
    const auto sound_reader = SceneReader::open(memory_source(sound));
    REQUIRE(sound_reader.ok());
    const Played expected = play(**sound_reader);
    REQUIRE((*sound_reader)->segments().size() >= stretches);
    for (std::size_t at = 0; at < sizes.front(); ++at) {
      Bytes bytes = sound;
      bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << (5 * at + at / 8) % 8);
      INFO("byte " << at << " of " << sizes.front());
      REQUIRE_FALSE(testing::issues_of(bytes).empty());
      const auto reader = SceneReader::open(memory_source(bytes));
      REQUIRE(reader.ok());
      REQUIRE((*reader)->form() == (*sound_reader)->form());
      REQUIRE(play(**reader).whole == expected.whole);
    }
  }
}

TEST_CASE("a flipped bit is found wherever it is, and the other segments play on") {
  flip_each_byte(Profile::kLossless);
  flip_each_byte(Profile::kQuantised);
  if (check_profile(Profile::kDraco).ok()) flip_each_byte(Profile::kDraco);
}
