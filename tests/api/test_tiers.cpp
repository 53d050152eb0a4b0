// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <numeric>

#include "scene_fixture.h"
#include "tiers.h"

using namespace stgs;
using Catch::Detail::Approx;

namespace {

// Primitives by tier of a scene of so many, packed with the tiers that are chosen.
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

TEST_CASE("tiers are three of like size where a moment has few primitives, or as many as asked") {
  for (const double needed : {0.0, 1000.0, 110000.0}) {
    CHECK(tier_shares(0, needed) == std::vector<double>(3, 1.0 / 3));
  }
  CHECK(tier_shares(5, 1e7) == std::vector<double>(5, 0.2));
  CHECK(tier_shares(1, 1e7) == std::vector<double>{1.0});
}

TEST_CASE("where a moment has many, the first tier is as small as ever and the others grow") {
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

TEST_CASE("a tier holds what matters more than all of the next, and none is small") {
  std::vector<float> importance(30000);
  for (std::size_t i = 0; i < importance.size(); ++i) {
    importance[i] = static_cast<float>(i * 7919 % importance.size());
  }
  const std::vector<float> needed(importance.size(), 1.0f);
  CHECK(tier_bounds(importance, needed, 3) == tier_bounds(importance, needed, 0));
  const std::vector<float> bounds{26999.0f, 26700.0f, 17700.0f};
  std::vector<std::uint32_t> all(importance.size());
  std::iota(all.begin(), all.end(), 0u);
  const std::vector<Tier> tiers = tiers_of(all, importance, bounds);
  REQUIRE(tiers.size() == 3);  // the second, of 299, goes with the first
  CHECK(tiers[0].members.size() == 3300);
  CHECK(tiers[1].members.size() == 9000);
  for (std::size_t t = 0; t + 1 < tiers.size(); ++t) {
    const auto less = [&](std::uint32_t a, std::uint32_t b) {
      return importance[a] < importance[b];
    };
    const auto& here = tiers[t].members;
    const auto& next = tiers[t + 1].members;
    CHECK(importance[*std::min_element(here.begin(), here.end(), less)] >
          importance[*std::max_element(next.begin(), next.end(), less)]);
    CHECK(std::is_sorted(here.begin(), here.end()));
  }
}

TEST_CASE("of many a tier is as large at a moment as it is to be, whatever lives longest") {
  // What matters most lives through the clip, the rest for a tenth of it.
  constexpr std::size_t kLong = 200000, kBrief = 1000000;
  std::vector<float> importance(kLong + kBrief), needed(kLong + kBrief, 0.1f);
  std::iota(importance.rbegin(), importance.rend(), 0.0f);
  std::fill_n(needed.begin(), kLong, 1.0f);
  const std::vector<float> bounds = tier_bounds(importance, needed, 0);
  REQUIRE(bounds.size() == 2);  // 36,864, 73,728 and the other 189,408 of the 300,000 of a moment
  for (std::size_t t = 0; t < bounds.size(); ++t) {
    double first = 0;
    for (std::size_t i = 0; i < importance.size(); ++i) {
      if (importance[i] >= bounds[t]) first += needed[i];
    }
    CHECK(first == Approx(t == 0 ? 36864 : 110592).margin(2));
  }
}

TEST_CASE("a file begins small where all is seen at once, and in thirds where it comes in turn") {
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
