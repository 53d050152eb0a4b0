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
  auto matcher = make_cuda_matcher();
  INFO(matcher.status().message());
  REQUIRE(matcher.ok());
  return std::move(*matcher);
}

}  // namespace

// With no iteration, a pass computes the costs of the given planes, and of random ones.
TEST_CASE("costs of planes on CUDA match the CPU") {
  const std::vector<StereoView> views = rig();
  const auto cpu = make_cpu_matcher(), gpu = on_gpu();
  std::vector<StereoMap> maps = matched(views, *cpu);
  REQUIRE(maps.size() == views.size());
  const std::vector<std::uint32_t> corners(std::size_t{1} * kWidth * kHeight, 0x20304050u);
  std::vector<std::uint32_t> texture(corners.size());
  for (std::size_t i = 0; i < texture.size(); ++i) texture[i] = 0x01010101u * views[0].grey[i];
  std::vector<float> depth(corners.size(), 4.0f);
  ViewPass pass;
  pass.problem.reference = {texture.data(), depth.data(), kWidth, kHeight, 90, 90, 48, 36};
  pass.problem.source_count = 2;
  pass.problem.nearest = kRange.nearest;
  pass.problem.farthest = kRange.farthest;
  pass.problem.consistency = 0.05f;
  for (int k = 0; k < 2; ++k) {
    StereoSource& source = pass.problem.sources[k];
    source.image = {
        k == 0 ? texture.data() : corners.data(), depth.data(), kWidth, kHeight, 90, 90, 48, 36};
    source.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    source.translation = {0.2f - 0.5f * static_cast<float>(k), 0.1f, 0.05f};
    source = derived_source(pass.problem.reference, source);
  }
  for (std::size_t i = 0; i < corners.size(); i += 3) maps[0].planes[i].depth = 0.0f;
  std::vector<Hypothesis> planes[2] = {maps[0].planes, maps[0].planes};
  std::vector<float> costs[2] = {std::vector<float>(corners.size()),
                                 std::vector<float>(corners.size())};
  for (int k = 0; k < 2; ++k) {
    pass.map = {planes[k].data(), costs[k].data()};
    const Status status = (k == 0 ? *cpu : *gpu).run(pass);
    INFO(status.message());
    REQUIRE(status.ok());
  }
  int different = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    REQUIRE(planes[1][i].depth == Approx(planes[0][i].depth).epsilon(1e-5));
    different += std::abs(costs[1][i] - costs[0][i]) > 2e-3f ? 1 : 0;
  }
  // Rounding decides whether a point at the border of a source is seen.
  CHECK(different < 0.002 * static_cast<double>(corners.size()));
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
