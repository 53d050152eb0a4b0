// SPDX-License-Identifier: Apache-2.0
// Costs of paths through a volume on every vector target, against their definition.
#include "geometry/path_costs.h"

#include <algorithm>
#include <cmath>

#include "catch.h"
#include "geometry/sweep_rule.h"
#include "train/random.h"
#include "vector_targets.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::geometry;
using namespace stgs::testing;

namespace {

constexpr int kWidth = 9, kHeight = 7;

using Costs = std::vector<int>;  // of the planes of a pixel

// The path to pixel (x, y), by recursion along it.
Costs path_to(const CostVolume& volume, const std::vector<float>& grey, int x, int y, int dx,
              int dy) {
  const auto* own = &volume.cost[volume.at(x, y)];
  Costs out(own, own + volume.planes);
  const int px = x - dx, py = y - dy;
  if (px < 0 || py < 0 || px >= kWidth || py >= kHeight) return out;
  const Costs from = path_to(volume, grey, px, py, dx, dy);
  const int best = *std::min_element(from.begin(), from.end());
  const auto at = [&](int gx, int gy) { return grey[static_cast<std::size_t>(gy * kWidth + gx)]; };
  const int step = large_step(std::abs(at(x, y) - at(px, py)));
  for (int k = 0; k < volume.planes; ++k) {
    int path = std::min(from[static_cast<std::size_t>(k)], best + step);
    for (const int side : {k - 1, k + 1}) {
      if (side < 0 || side >= volume.planes) continue;
      path = std::min(path, from[static_cast<std::size_t>(side)] + kSmallStep);
    }
    out[static_cast<std::size_t>(k)] += path - best;
  }
  return out;
}

}  // namespace

TEST_CASE("sums of path costs match their definition") {
  Random random(3, 0, RandomPurpose::kStereo);
  std::vector<float> grey(kWidth * kHeight);
  for (float& value : grey) value = static_cast<float>(random.below(256));
  for (const int planes : {1, 8, 16, 37}) {
    CostVolume volume(kWidth, kHeight, planes);
    for (std::uint8_t& cost : volume.cost) cost = static_cast<std::uint8_t>(random.below(256));
    for_each_vector_target([&] {
      CostVolume found = volume;
      for (const int step : {1, -1}) {
        add_paths(grey, step, 0, &found);
        add_paths(grey, 0, step, &found);
      }
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          Costs expected(static_cast<std::size_t>(planes));
          for (const auto& [dx, dy] :
               {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}}) {
            const Costs path = path_to(volume, grey, x, y, dx, dy);
            for (std::size_t k = 0; k < path.size(); ++k) expected[k] += path[k];
          }
          const auto* sums = &found.sum[found.at(x, y)];
          CHECK(Costs(sums, sums + planes) == expected);
        }
      }
    });
  }
}
