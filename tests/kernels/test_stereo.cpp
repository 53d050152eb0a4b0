// SPDX-License-Identifier: Apache-2.0
// Multi-view stereo: the cost of a plane, and depth and normals of a rendered scene.
#include "geometry/stereo.h"

#include <cmath>

#include "catch.h"
#include "geometry/stereo_rows.h"
#include "stereo_scene.h"

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

TEST_CASE("costs of a support do not depend on vectors") {
  // A map of one pass has the costs of the vectorised rows; each is computed again without vectors.
  std::vector<StereoView> views = rig();
  const std::vector<StereoMap> maps = matched(views, *make_cpu_matcher());
  REQUIRE(maps.size() == views.size());
  std::vector<std::uint32_t> corners[2];
  for (int i = 0; i < 2; ++i) {
    const std::vector<std::uint8_t>& grey = views[static_cast<std::size_t>(i)].grey;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const auto value = [&](int px, int py) {
          return std::uint32_t{grey[static_cast<std::size_t>(std::min(py, kHeight - 1) * kWidth +
                                                             std::min(px, kWidth - 1))]};
        };
        corners[i].push_back(value(x, y) | value(x + 1, y) << 8 | value(x, y + 1) << 16 |
                             value(x + 1, y + 1) << 24);
      }
    }
  }
  const auto image = [&](int i) {
    const StereoView& v = views[static_cast<std::size_t>(i)];
    return StereoImage{corners[i].data(), nullptr, v.width, v.height, v.fx, v.fy, v.cx, v.cy};
  };
  StereoProblem problem{};
  problem.reference = image(0);
  problem.source_count = 1;
  problem.nearest = kRange.nearest;
  problem.farthest = kRange.farthest;
  problem.sources[0].image = image(1);
  problem.sources[0].rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  problem.sources[0].translation = {-0.5f, 0.1f, 0.05f};
  problem.sources[0] = derived_source(problem.reference, problem.sources[0]);
  std::vector<Hypothesis> planes = maps[0].planes;
  std::vector<float> costs(planes.size());
  const PlaneMap map{planes.data(), costs.data()};
  for (int y = 0; y < kHeight; ++y) start_row(problem, map, y, 1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
      Support support{};
      load_support(problem.reference, x, y, &support);
      const float expected = hypothesis_cost(problem, support, x, y, planes[at], ScalarSums());
      REQUIRE(costs[at] == Approx(expected).margin(2e-3));
    }
  }
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
