// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <numeric>

#include "catch.h"
#include "fixtures/scene_fixture.h"
#include "quantise/tiers.h"

using namespace stgs;

namespace {

// Number of primitives in each tier of the packed scene, with automatic tiers.
std::map<int, std::uint64_t> tiers_in_file(const Scene& scene) {
  WriteSettings settings;
  settings.profile = Profile::kQuantised;
  auto bytes = encode_scene(scene, settings);
  REQUIRE(bytes.ok());
  const auto reader = SceneReader::open(memory_source(std::move(*bytes), "tiers"));
  REQUIRE(reader.ok());
  std::map<int, std::uint64_t> out;
  for (const SegmentInfo& segment : (*reader)->segments()) out[segment.tier] += segment.primitives;
  return out;
}

}  // namespace

TEST_CASE("tiers are equal: three for few active primitives, or as many as requested") {
  for (const double needed : {0.0, 1000.0, 110000.0}) {
    CHECK(tier_shares(0, needed) == std::vector<double>(3, 1.0 / 3));
  }
  CHECK(tier_shares(5, 1e7) == std::vector<double>(5, 0.2));
  CHECK(tier_shares(1, 1e7) == std::vector<double>{1.0});
}

TEST_CASE("with many active primitives, the first tier stays small and the others double in size") {
  for (const double needed : {130e3, 1e6, 1.7e6, 1e9}) {
    const std::vector<double> shares = tier_shares(0, needed);
    REQUIRE(shares.size() >= 2);
    CHECK(shares.size() <= 16);
    CHECK(shares[0] * needed == Approx(36864.0));
    for (std::size_t t = 1; t + 1 < shares.size(); ++t) {
      CHECK(shares[t] == Approx(2 * shares[t - 1]));
    }
    CHECK(shares.back() >= shares[shares.size() - 2]);
    CHECK(std::accumulate(shares.begin(), shares.end(), 0.0) == Approx(1.0));
  }
}

namespace {

// n distinct importances in no particular order.
std::vector<float> importances(std::size_t n) {
  std::vector<float> out(n);
  for (std::size_t i = 0; i < n; ++i) out[i] = static_cast<float>(i * 7919 % n);
  return out;
}

std::vector<std::uint32_t> all_of(std::size_t n) {
  std::vector<std::uint32_t> out(n);
  std::iota(out.begin(), out.end(), 0u);
  return out;
}

std::vector<std::size_t> sizes_of(const std::vector<Tier>& tiers) {
  std::vector<std::size_t> out;
  for (const Tier& tier : tiers) out.push_back(tier.members.size());
  return out;
}

void check_order(const std::vector<Tier>& tiers, const std::vector<float>& importance) {
  const auto less = [&](std::uint32_t a, std::uint32_t b) { return importance[a] < importance[b]; };
  for (std::size_t t = 0; t + 1 < tiers.size(); ++t) {
    const auto& current = tiers[t].members;
    const auto& next = tiers[t + 1].members;
    CHECK(importance[*std::min_element(current.begin(), current.end(), less)] >
          importance[*std::max_element(next.begin(), next.end(), less)]);
  }
  for (const Tier& tier : tiers) CHECK(std::is_sorted(tier.members.begin(), tier.members.end()));
}

}  // namespace

TEST_CASE("a tier is more important than the next, and no tier is small") {
  const std::vector<float> importance = importances(30000);
  const std::vector<std::uint32_t> all = all_of(importance.size());
  for (const bool graded : {false, true}) {
    const std::vector<Tier> tiers =
        tiers_of(all, importance, {{26999.0f, 26700.0f, 17700.0f}, graded});
    // The tier of 299 is merged into the first.
    CHECK(sizes_of(tiers) == std::vector<std::size_t>{3300, 9000, 17700});
    check_order(tiers, importance);
  }
  // A small first tier is merged with the next, unless a graded plan has a large rest.
  const std::vector<float> bounds{29800.0f, 20000.0f};
  CHECK(sizes_of(tiers_of(all, importance, {bounds, false})) ==
        std::vector<std::size_t>{10000, 20000});
  const std::vector<Tier> graded = tiers_of(all, importance, {bounds, true});
  CHECK(sizes_of(graded) == std::vector<std::size_t>{200, 9800, 20000});
  check_order(graded, importance);
}

TEST_CASE("a graded plan puts an eighth of a large unimportant segment into its first tier") {
  const std::vector<float> importance = importances(16000);
  const std::vector<std::uint32_t> all = all_of(importance.size());
  const std::vector<float> bounds{90000.0f, 80000.0f};
  const std::vector<Tier> tiers = tiers_of(all, importance, {bounds, true});
  CHECK(sizes_of(tiers) == std::vector<std::size_t>{2000, 14000});
  CHECK(tiers[0].importance == 2);
  CHECK(tiers[1].importance == 2);
  check_order(tiers, importance);
  CHECK(sizes_of(tiers_of(all, importance, {bounds, false})) == std::vector<std::size_t>{16000});
  // A segment within the first tier, or with few primitives, is not divided.
  CHECK(tiers_of(all, importance, {{0.0f, 0.0f}, true}).size() == 1);
  CHECK(tiers_of(all_of(4000), importance, {bounds, true}).size() == 1);
}

TEST_CASE("equally important primitives do not all go to the first tier of a graded plan") {
  const std::vector<float> equal(200000, 1.0f);
  const std::vector<std::uint32_t> all = all_of(equal.size());
  const TierPlan plan = plan_tiers(equal, {std::vector<float>(equal.size(), 1.0f), 200000}, 0);
  REQUIRE(plan.graded);
  CHECK(sizes_of(tiers_of(all, equal, plan)) == std::vector<std::size_t>{36864, 163136});
}

TEST_CASE("the peak demand makes the plan graded, and long-lived primitives count most") {
  // 60,000 are active all the time and 400,000 for a hundredth of it.
  std::vector<float> importance(460000);
  std::iota(importance.rbegin(), importance.rend(), 0.0f);
  Demand needed{std::vector<float>(importance.size(), 0.01f), 460000};
  std::fill_n(needed.shares.begin(), 60000, 1.0f);
  const TierPlan plan = plan_tiers(importance, needed, 0);
  CHECK(plan.graded);
  CHECK(plan.bounds.size() == 3);  // 36,864 of 460,000, then twice and four times that
  needed.peak = 64000;             // the mean demand
  CHECK_FALSE(plan_tiers(importance, needed, 0).graded);
  CHECK(plan.bounds[0] == Approx(460000 - 64000.0 * 36864 / 460000).margin(2));
}

TEST_CASE("a graded tier has its intended size at any time, even if lifespans differ") {
  // The most important primitives last for the complete clip, the rest for a tenth of it.
  constexpr std::size_t kLong = 200000, kShort = 1000000;
  std::vector<float> importance(kLong + kShort);
  std::iota(importance.rbegin(), importance.rend(), 0.0f);
  Demand needed{std::vector<float>(kLong + kShort, 0.1f), 300000};
  std::fill_n(needed.shares.begin(), kLong, 1.0f);
  const TierPlan plan = plan_tiers(importance, needed, 0);
  CHECK(plan.graded);
  REQUIRE(plan.bounds.size() == 2);  // 36,864, 73,728 and the other 189,408 at a time
  for (std::size_t t = 0; t < plan.bounds.size(); ++t) {
    double first = 0;
    for (std::size_t i = 0; i < importance.size(); ++i) {
      if (importance[i] >= plan.bounds[t]) first += needed.shares[i];
    }
    CHECK(first == Approx(t == 0 ? 36864 : 110592).margin(2));
  }
  CHECK_FALSE(plan_tiers(importance, needed, 3).graded);
  CHECK(plan_tiers(importance, needed, 3).bounds == plan_tiers(importance, {{}, 90000}, 0).bounds);
}

TEST_CASE("demand is measured from the active segments, and its peak counts") {
  // Two parts of 100 and 50 ticks with chunks of 10: a persistent segment and two chunks in the
  // first part, a persistent segment in the second.
  const std::vector<PartRange> parts{{0, 30, {0, 100}}, {30, 40, {100, 150}}};
  const std::vector<std::vector<SegmentMembers>> segments{
      {{{-1, 0}, {0, 1, 2}}, {{0, 0}, {3, 4}}, {{0, 2}, {5, 6, 7, 8}}}, {{{-1, 0}, {9}}}};
  const Demand needed = measure_demand(parts, segments, 10, 10);
  CHECK(needed.peak == 7);  // not 9: one segment ends where the other begins
  CHECK(needed.shares[0] == Approx(100.0 / 150));
  CHECK(needed.shares[5] == Approx(10.0 / 150));
  CHECK(needed.shares[9] == Approx(50.0 / 150));
}

TEST_CASE("primitives that a cut removes or that precede the timeline have no demand") {
  const std::vector<PartRange> parts{{0, 3, {0, 30}, TickRange{0, 25}},
                                     {3, 8, {20, 50}, TickRange{25, 50}},
                                     {8, 12, {-20, 0}, {}}};
  const std::vector<std::vector<SegmentMembers>> segments{
      {{{-1, 0}, {0, 1, 2}}}, {{{-1, 0}, {3, 4, 5, 6, 7}}}, {{{-1, 0}, {8, 9, 10, 11}}}};
  const Demand needed = measure_demand(parts, segments, 10, 12);
  CHECK(needed.peak == 5);
  CHECK(needed.shares[0] == Approx(25.0 / 80));
  CHECK(needed.shares[3] == Approx(25.0 / 80));
  CHECK(needed.shares[8] == 0.0f);
}

TEST_CASE("a file has a small first tier if all primitives are visible at once, else thirds") {
  Scene scene = testing::random_scene(150000, 0, 60, 5);
  Gaussians4D& set = scene.gaussians;
  std::fill(set.velocity.begin(), set.velocity.end(), 0.0f);
  std::fill(set.opacity_logit.begin(), set.opacity_logit.end(), 2.0f);
  std::fill(set.sigma.begin(), set.sigma.end(), 1.0f);
  std::fill(set.radius.begin(), set.radius.end(), 60.0f);
  CHECK(tiers_in_file(scene).at(0) == Approx(36864).margin(600));
  for (std::size_t i = 0; i < set.size(); ++i) {
    set.time[i] = static_cast<float>(i % 60);
    set.radius[i] = 1.0f;
  }
  CHECK(tiers_in_file(scene).at(0) == Approx(50000).epsilon(0.02));
}
