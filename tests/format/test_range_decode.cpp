// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <utility>

#include "catch.h"
#include "codec/values.h"
#include "container/segment.h"
#include "fixtures/scene_fixture.h"
#include "head_fixture.h"

using namespace stgs;
using stgs::testing::head_of;
using stgs::testing::random_scene;

namespace {

constexpr std::uint64_t kAllValues = std::numeric_limits<std::uint64_t>::max();
constexpr std::size_t kPrimitives = 150'000;  // several ranges

// Primitives of one segment, with SH of degree 0 to 3.
Scene long_segment() {
  Scene scene = random_scene(kPrimitives, 3, 30, 7);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.radius.begin(), set.radius.end(), 60.0f);
  for (std::size_t i = 0; i < kPrimitives; ++i) {
    constexpr std::size_t kCoefficients[] = {1, 4, 9, 16};
    for (std::size_t c = 3 * kCoefficients[i % 4]; c < 48; ++c) set.sh[48 * i + c] = 0.0f;
  }
  return scene;
}

// Returns whether `part` has the values of `whole` from primitive `begin` on.
bool equals(const FloatArray& part, const FloatArray& whole, std::size_t width, std::size_t begin) {
  return std::equal(part.begin(), part.end(),
                    whole.begin() + static_cast<std::ptrdiff_t>(width * begin));
}

void check_same(const Gaussians4D& range, const Gaussians4D& set, std::size_t begin) {
  CHECK(equals(range.position, set.position, 3, begin));
  CHECK(equals(range.time, set.time, 1, begin));
  CHECK(equals(range.sigma, set.sigma, 1, begin));
  CHECK(equals(range.radius, set.radius, 1, begin));
  CHECK(equals(range.velocity, set.velocity, 3, begin));
  CHECK(equals(range.log_scale, set.log_scale, 3, begin));
  CHECK(equals(range.rotation, set.rotation, 4, begin));
  CHECK(equals(range.opacity_logit, set.opacity_logit, 1, begin));
  CHECK(range.time_origin == set.time_origin);
  const auto own = static_cast<std::size_t>(3 * range.sh_coefficients());
  const auto all = static_cast<std::size_t>(3 * set.sh_coefficients());
  bool same = true;
  for (std::size_t i = 0; i < range.size(); ++i)
    same =
        same && std::equal(&range.sh[own * i], &range.sh[own * i] + 3, &set.sh[all * (begin + i)]);
  CHECK(same);
}

// Checks that a range has all SH of `set` that are not 0.
void check_sh(const Gaussians4D& range, const Gaussians4D& set, std::size_t begin) {
  const auto own = static_cast<std::size_t>(3 * range.sh_coefficients());
  const auto all = static_cast<std::size_t>(3 * set.sh_coefficients());
  bool same = true;
  for (std::size_t i = 0; i < range.size(); ++i) {
    const float* const row = &set.sh[all * (begin + i)];
    same = same && std::equal(row, row + own, &range.sh[own * i]) &&
           std::all_of(row + own, row + all, [](float v) { return v == 0.0f; });
  }
  CHECK(same);
}

}  // namespace

TEST_CASE("primitives that are decoded in ranges equal those that are decoded together") {
  const Scene scene = long_segment();
  for (const Profile profile : {Profile::kLossless, Profile::kQuantised}) {
    WriteSettings settings;
    settings.profile = profile;
    const auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    const FileHead head = head_of(*bytes);
    std::size_t ranges = 0, primitives = 0;
    for (std::uint32_t s = 0; s < head.index.segments.size(); ++s) {
      Findings findings;
      SegmentRecords records;
      Gaussians4D set;
      REQUIRE(read_segment(*memory_source(*bytes), head, s, true, records, findings));
      REQUIRE(decode_segment(records, head, s, kAllAttributes, TimeOrigin::kRecord, set, findings));
      const auto visit = [&](const Gaussians4D& range, std::size_t begin) {
        check_same(range, set, begin);
        check_sh(range, set, begin);
        ++ranges;
        primitives += range.size();
      };
      DecodingWork work{decoded_values(records, head, s)};
      CHECK(decode_ranges(records, head, s, visit, work, findings));
      CHECK(work.values == 0);
      CHECK(findings.ok());
    }
    CHECK(primitives == head.index.primitives);
    CHECK(ranges > head.index.segments.size());
  }
}

TEST_CASE("ranges that are passed on have the values of their segment, and the SH that were read") {
  Scene scene = random_scene(100'000, 2, 30, 9);
  std::fill(scene.gaussians.radius.begin(), scene.gaussians.radius.end(), 60.0f);
  // Quantised primitives have different SH degrees.
  for (const auto& [profile, with_sh] :
       {std::pair(Profile::kLossless, true), std::pair(Profile::kQuantised, true),
        std::pair(Profile::kQuantised, false)}) {
    WriteSettings settings;
    settings.profile = profile;
    const auto bytes = encode_scene(scene, settings);
    REQUIRE(bytes.ok());
    const auto reader = SceneReader::open(memory_source(*bytes));
    REQUIRE(reader.ok());
    std::size_t primitives = 0, ranges = 0;
    for (std::uint32_t s = 0; s < (*reader)->segments().size(); ++s) {
      const TimeOrigin origin = s % 2 == 0 ? TimeOrigin::kPart : TimeOrigin::kRecord;
      const auto set = (*reader)->decode(s, with_sh, origin);
      REQUIRE(set.ok());
      const int degree = with_sh ? 2 : 0;
      const auto visit = [&](const Gaussians4D& range, std::size_t begin) {
        check_same(range, *set, begin);
        check_sh(range, *set, begin);
        CHECK(range.sh_degree == degree);
        primitives += range.size();
        ++ranges;
      };
      CHECK((*reader)->decode_ranges(s, with_sh, origin, visit).ok());
    }
    CHECK(primitives == (*reader)->primitives());
    CHECK(ranges > (*reader)->segments().size());
  }
}

TEST_CASE("damage in any range of a segment is an error of the segment") {
  const auto bytes = encode_scene(long_segment(), WriteSettings());
  REQUIRE(bytes.ok());
  const FileHead head = head_of(*bytes);
  Findings findings;
  SegmentRecords records;
  REQUIRE(read_segment(*memory_source(*bytes), head, 0, true, records, findings));
  std::size_t groups = 0;
  for (SegmentRecord* record : {&records.base, &records.sh}) {
    for (const SegmentRecord::Unit& unit : record->units) {
      if (unit.bytes.size() < 1000) continue;
      ++groups;
      std::uint8_t& last = const_cast<std::uint8_t&>(unit.bytes.back());
      last ^= 1;  // the last word of the last block
      Findings found, together;
      Gaussians4D set;
      DecodingWork work{kAllValues};
      CHECK_FALSE(decode_ranges(records, head, 0, nullptr, work, found));
      CHECK_FALSE(
          decode_segment(records, head, 0, kAllAttributes, TimeOrigin::kRecord, set, together));
      CHECK(found.status("x").message() == together.status("x").message());
      last ^= 1;
    }
  }
  CHECK(groups > 5);
}

TEST_CASE("problems of primitives are counted over ranges") {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  Gaussians4D set = random_scene(10, 1, 1, 3).gaussians;
  PrimitiveChecks checks;
  checks.add(set, kAllAttributes, 0, 10);
  set.sigma[2] = 0.0f;
  set.position[3 * 5 + 1] = kInfinity;
  set.sh[12 * 7 + 11] = kInfinity;  // of degree 1
  checks.add(set, kAllAttributes & ~attribute_bit(Attribute::kSh1), 100, 10);
  Findings findings;
  checks.report(4, 0, findings);
  const std::vector<Issue> issues = findings.take();
  REQUIRE(issues.size() == 2);
  CHECK(issues[0].number == static_cast<int>(IssueNumber::kNotFinite));
  CHECK(issues[0].message == "segment 4: position not finite in 1 of 20 primitives (first: 105)");
  CHECK(issues[1].message == "segment 4: sigma <= 0 in 1 of 20 primitives (first: 102)");
}
