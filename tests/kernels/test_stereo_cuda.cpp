// SPDX-License-Identifier: Apache-2.0
// Compares multi-view stereo on CUDA with the CPU. Exit code 77: no device.
#include <cmath>

#include "catch.h"
#include "catch_runner.h"
#include "stereo_scene.h"

using namespace stgs;
using namespace stgs::testing;

namespace {

std::unique_ptr<ViewMatcher> on_gpu() {
  auto matcher = make_cuda_matcher(0);
  INFO(matcher.status().message());
  REQUIRE(matcher.ok());
  return std::move(*matcher);
}

}  // namespace

TEST_CASE("costs of planes on CUDA match the CPU") {
  const std::vector<StereoView> views = rig();
  const std::vector<StereoMap> maps = matched(views, *make_cpu_matcher());
  REQUIRE(maps.size() == views.size());
  Pass scene(views, maps);
  scene.problem.consistency = GENERATE(0.0f, 0.05f);  // 0: there is no earlier pass
  const auto gpu = on_gpu();
  // From random planes, and from those of the map.
  for (const bool from_random : {true, false}) {
    std::vector<Hypothesis> planes = maps[1].planes;
    std::vector<float> costs(planes.size());
    ViewPass pass;
    pass.problem = scene.problem;
    pass.map = {planes.data(), costs.data()};
    pass.from_random = from_random;
    pass.first = 3;
    pass.iterations = from_random ? 0 : 1;
    const Status status = gpu->run(pass);
    INFO(status.message());
    REQUIRE(status.ok());
    // Rounding decides whether a point at the border of a source is seen.
    CHECK(scene.share_of_wrong_costs(pass.map) < 0.002);
  }
}

TEST_CASE("stereo on CUDA is as accurate as on the CPU, and repeats to the bit") {
  const std::vector<StereoView> views = rig();
  const auto cpu = make_cpu_matcher(), gpu = on_gpu();
  const std::vector<StereoMap> found = matched(views, *gpu), again = matched(views, *gpu);
  const Accuracy a = accuracy_of(views, matched(views, *cpu)), b = accuracy_of(views, found);
  REQUIRE(a.confirmed > 0.7);
  CHECK(b.confirmed > a.confirmed - 0.02);
  CHECK(b.deep > a.deep - 0.01);
  CHECK(b.turned > a.turned - 0.03);
  REQUIRE(again.size() == views.size());
  for (std::size_t i = 0; i < views.size(); ++i) CHECK(found[i].costs == again[i].costs);
}
