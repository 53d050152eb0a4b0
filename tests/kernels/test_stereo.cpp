// SPDX-License-Identifier: Apache-2.0
// Multi-view stereo: the cost of a plane, and depth and normals of a rendered scene.
#include "geometry/stereo.h"

#include <cmath>

#include "catch.h"
#include "geometry/stereo_rows.h"
#include "stereo_scene.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::geometry;
using namespace stgs::testing;

TEST_CASE("stereo finds depth and normals of slanted surfaces at their edges") {
  const std::vector<StereoView> views = rig();
  const Accuracy found = accuracy_of(views, matched(views, *make_cpu_matcher()));
  CHECK(found.confirmed > 0.7);
  CHECK(found.deep > 0.96);
  CHECK(found.turned > 0.8);
}

TEST_CASE("vectorised costs are those of the scalar reference") {
  const std::vector<StereoView> views = rig();
  const std::vector<StereoMap> maps = matched(views, *make_cpu_matcher());
  REQUIRE(maps.size() == views.size());
  const Pass pass(views, maps);
  // Rounding decides whether a point at the border of a source is seen.
  for_each_vector_target([&] {
    std::vector<Hypothesis> planes(maps[1].planes.size());
    std::vector<float> costs(planes.size());
    const PlaneMap map{planes.data(), costs.data()};
    for (int y = 0; y < kHeight; ++y) start_row(pass.problem, map, y, 1);
    CHECK(pass.share_of_wrong_costs(map) < 0.002);
    // An update computes the cost of a pixel's plane again.
    planes = maps[1].planes;
    std::fill(costs.begin(), costs.end(), 0.0f);
    for (const int colour : {0, 1})
      for (int y = 0; y < kHeight; ++y) update_row(pass.problem, map, y, colour, 3, 1);
    CHECK(pass.share_of_wrong_costs(map) < 0.002);
  });
}

TEST_CASE("vectorised updates take the planes that the scalar reference takes") {
  const std::vector<StereoView> views = rig();
  const std::vector<StereoMap> maps = matched(views, *make_cpu_matcher());
  REQUIRE(maps.size() == views.size());
  const Pass pass(views, maps);
  StereoProblem problem = pass.problem;
  problem.consistency = GENERATE(0.0f, 0.05f);  // 0: there is no earlier pass
  std::vector<Hypothesis> expected = maps[1].planes;
  std::vector<float> expected_costs = maps[1].costs;
  const PlaneMap reference{expected.data(), expected_costs.data()};
  for (int y = 0; y < kHeight; ++y)
    for (int x = y & 1; x < kWidth; x += 2) update_pixel(problem, reference, x, y, 0, 5);
  for_each_vector_target([&] {
    std::vector<Hypothesis> planes = maps[1].planes;
    std::vector<float> costs = maps[1].costs;
    for (int y = 0; y < kHeight; ++y)
      update_row(problem, {planes.data(), costs.data()}, y, 0, 0, 5);
    int different = 0;
    for (std::size_t i = 0; i < planes.size(); ++i)
      different += std::abs(planes[i].depth / expected[i].depth - 1) > 1e-4f ? 1 : 0;
    // Rounding decides between equal costs.
    CHECK(different < 0.01 * static_cast<double>(planes.size()));
  });
}

TEST_CASE("stereo confirms nothing between unrelated images") {
  std::vector<StereoView> views = rig();
  for (std::size_t i = 0; i < views.size(); ++i) {
    Random random(7, i, RandomPurpose::kStereo);
    for (std::uint8_t& grey : views[i].grey) grey = static_cast<std::uint8_t>(random.below(256));
  }
  int confirmed = 0;
  const std::vector<StereoMap> maps = matched(views, *make_cpu_matcher());
  REQUIRE(maps.size() == views.size());
  for (const StereoMap& map : maps) {
    for (const std::uint8_t count : map.confirmations) confirmed += count > 0 ? 1 : 0;
  }
  CHECK(confirmed < 0.002 * 4 * kWidth * kHeight);
}

TEST_CASE("stereo ends with the first error") {
  const auto matcher = make_cpu_matcher();
  int calls = 0;
  const auto twice = [&](int count, const std::function<Status(int)>& task) -> Status {
    if (++calls > 2) return runtime_error("cancelled");
    return in_order(count, task);
  };
  CHECK(match_views(rig(), kRange, *matcher, twice).status().message() == "cancelled");
  CHECK(calls == 3);
  calls = -kStereoLoops;
  CHECK(match_views(rig(), kRange, *matcher, twice).ok());
  CHECK(calls == 0);
}
