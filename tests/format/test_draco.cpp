// SPDX-License-Identifier: Apache-2.0
// The draco profile: the quantised profile with positions coded by Draco (spec, annex C).
#include <algorithm>
#include <random>

#include "catch.h"
#include "codec/draco_points.h"
#include "codec/stream.h"
#include "fixtures/scene_fixture.h"

using namespace stgs;
using stgs::testing::fingerprints;
using stgs::testing::random_scene;
using Bytes = std::vector<std::uint8_t>;

namespace {

// The byte planes of these keys, sorted.
Bytes planes_of(std::vector<std::uint64_t> keys) {
  std::sort(keys.begin(), keys.end());
  Bytes planes;
  for (int c = 0; c < 3; ++c) {
    for (int shift : {0, 8, 16}) {
      for (const std::uint64_t key : keys) {
        planes.push_back(static_cast<std::uint8_t>(compact_key(key >> c) >> shift));
      }
    }
  }
  return planes;
}

// Three points, two of them equal.
const std::vector<std::uint64_t> kThreeKeys = {morton_key(1, 2, 3), morton_key(0x1FFFFF, 0, 5),
                                               morton_key(1, 2, 3)};

Result<Scene> decoded(const Scene& scene, const WriteSettings& settings,
                      std::vector<std::uint32_t>& order) {
  STGS_ASSIGN(Bytes bytes, encode_scene(scene, settings, &order));
  STGS_ASSIGN(const auto issues, validate_scene(*memory_source(bytes)));
  CHECK(issues.empty());
  STGS_ASSIGN(const auto reader, SceneReader::open(memory_source(bytes)));
  CHECK(reader->profile() == settings.profile);
  if (settings.profile == Profile::kDraco) CHECK(reader->streams().front().bytes > 30);
  return read_scene(memory_source(std::move(bytes)));
}

}  // namespace

TEST_CASE("without libdraco the draco profile is rejected, naming the package") {
  if (check_draco().ok()) return;
  WriteSettings settings;
  settings.profile = Profile::kDraco;
  const auto bytes = encode_scene(random_scene(20, 1, 30, 2), settings);
  CHECK(bytes.status().code() == StatusCode::kNotBuilt);
  CHECK(bytes.status().message().find("libdraco-dev") != std::string::npos);
  CHECK(check_profile(Profile::kDraco).code() == StatusCode::kNotBuilt);
  CHECK(check_profile(Profile::kQuantised).ok());
}

TEST_CASE("a file of the draco profile opens everywhere and decodes if libdraco is built in") {
  const std::string path = STGS_TEST_DATA "/draco/draco.stgs";
  const auto reader = SceneReader::open(path);
  INFO(reader.status().message());
  REQUIRE(reader.ok());
  CHECK((*reader)->profile() == Profile::kDraco);
  const auto read = read_scene(path);
  if (!check_draco().ok()) {
    CHECK(read.status().code() == StatusCode::kNotBuilt);
    CHECK(read.status().message().find("libdraco-dev") != std::string::npos);
    const auto source = open_file(path);
    REQUIRE(source.ok());
    CHECK(validate_scene(**source).status().code() == StatusCode::kNotBuilt);
    return;
  }
  INFO(read.status().message());
  REQUIRE(read.ok());
  // For an external decoder, read() has already decoded Draco's part.
  const auto coded = (*reader)->read(0, true);
  REQUIRE(coded.ok());
  for (const CodedPlane& plane : coded->records.front().streams.front().planes) {
    CHECK(plane.source == CodedPlane::Source::kStored);
  }
  const auto quantised = read_scene(STGS_TEST_DATA "/draco/quantised.stgs");
  REQUIRE(quantised.ok());
  CHECK(fingerprints(read->gaussians) == fingerprints(quantised->gaussians));
}

TEST_CASE("the draco profile decodes to the bits of the quantised profile, in the same order") {
  if (!check_draco().ok()) return;
  Scene scene = random_scene(3000, 2, 60, 5);
  for (std::size_t i = 0; i < 600; ++i) scene.gaussians.position[i] = 0.25f;  // coincident points
  for (const std::size_t n :
       {std::size_t{1}, std::size_t{2}, std::size_t{70}, scene.gaussians.size()}) {
    Scene part = scene;
    std::vector<std::uint32_t> members(n);
    for (std::uint32_t i = 0; i < n; ++i) members[i] = i;
    part.gaussians = scene.gaussians.gather(members);
    for (const bool own_layouts : {false, true}) {
      INFO(n << " primitives");
      WriteSettings settings;
      settings.own_layouts = own_layouts;
      settings.profile = Profile::kQuantised;
      std::vector<std::uint32_t> order, draco_order;
      const auto quantised = decoded(part, settings, order);
      settings.profile = Profile::kDraco;
      const auto draco = decoded(part, settings, draco_order);
      INFO(draco.status().message());
      REQUIRE(quantised.ok());
      REQUIRE(draco.ok());
      CHECK(order == draco_order);
      CHECK(fingerprints(quantised->gaussians) == fingerprints(draco->gaussians));
    }
  }
}

TEST_CASE("point sets of all sizes and bit depths round-trip at every speed") {
  if (!check_draco().ok()) return;
  std::mt19937_64 random(3);
  for (const int bits : {0, 1, 9, 21}) {
    for (const std::size_t n : {std::size_t{1}, std::size_t{3}, std::size_t{500}}) {
      std::vector<std::uint64_t> keys(n);
      for (std::uint64_t& key : keys) key = random() & ((std::uint64_t{1} << 3 * bits) - 1);
      const Bytes planes = planes_of(keys);
      for (const int speed : {0, 5, 10}) {
        const Bytes stored = draco_encode(planes, n, speed);
        REQUIRE(draco_fits(stored, n));
        Bytes back(planes.size());
        REQUIRE(draco_decode(stored, n, back) == nullptr);
        CHECK(back == planes);
      }
    }
  }
}

TEST_CASE("draco_fits() rejects wrong headers before Draco parses them") {
  if (!check_draco().ok()) return;
  const Bytes planes = planes_of(kThreeKeys), stored = draco_encode(planes, 3);
  REQUIRE(draco_fits(stored, 3));
  CHECK_FALSE(draco_fits(stored, 2));
  CHECK_FALSE(draco_fits(stored, 4));
  CHECK_FALSE(draco_fits(std::span(stored).first(30), 3));
  CHECK_FALSE(draco_fits({}, 0));
  for (std::size_t at = 0; at < 31; ++at) {
    Bytes bytes = stored;
    bytes[at] ^= 0x80;  // magic, type, count, level or bit depth
    INFO("byte " << at);
    CHECK_FALSE(draco_fits(bytes, 3));
  }
  Bytes many = stored;  // both counts agree, but not with the record
  many[14] = many[30] = 0x20;
  CHECK_FALSE(draco_fits(many, 3));
}

TEST_CASE("damaged Draco bytes are rejected or decode to points in range") {
  if (!check_draco().ok()) return;
  const Bytes planes = planes_of(kThreeKeys), stored = draco_encode(planes, 3);
  Bytes back(planes.size());
  for (std::size_t size = 31; size < stored.size(); ++size) {
    INFO(size << " of " << stored.size() << " bytes");
    CHECK(draco_decode(std::span(stored).first(size), 3, back) != nullptr);
  }
  Bytes longer = stored;
  longer.push_back(0);
  CHECK(draco_decode(longer, 3, back) != nullptr);
  for (std::size_t at = 31; at < stored.size(); ++at) {
    for (int bit = 0; bit < 8; ++bit) {
      Bytes bytes = stored;
      bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ 1u << bit);
      if (draco_decode(bytes, 3, back) != nullptr) continue;
      for (std::size_t p : {2, 5, 8}) {  // the most significant digits of 21 bits
        for (std::size_t i = 0; i < 3; ++i) CHECK(back[3 * p + i] < 0x20);
      }
    }
  }
}

TEST_CASE("the Draco coder accepts only unpredicted positions") {
  StreamRow row;
  row.attribute = static_cast<std::uint16_t>(Attribute::kPosition);
  row.components = 3;
  row.mapping = static_cast<std::uint8_t>(Mapping::kLinear);
  row.coder = static_cast<std::uint8_t>(Coder::kDraco);
  row.digits = 3;
  row.digit_bits = {8, 8, 8};
  const auto accepted = [](const StreamRow& r) {
    Findings findings;
    const bool valid = check_row(r, 0, findings);
    if (!valid) CHECK(findings.take().front().number == 404);
    return valid;
  };
  CHECK(accepted(row));
  const auto changed = [&row](const auto& change) {
    StreamRow r = row;
    change(r);
    return r;
  };
  CHECK_FALSE(accepted(changed([](StreamRow& r) { r.digits = 2; })));
  CHECK_FALSE(accepted(changed([](StreamRow& r) { r.digit_bits[2] = 5; })));
  CHECK_FALSE(accepted(changed([](StreamRow& r) { r.prediction = 1; })));
  CHECK_FALSE(accepted(changed([](StreamRow& r) { r.mapping = 0; })));
  CHECK_FALSE(accepted(changed(
      [](StreamRow& r) { r.attribute = static_cast<std::uint16_t>(Attribute::kLogScale); })));
}
