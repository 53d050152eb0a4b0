// SPDX-License-Identifier: Apache-2.0
// The vectorised costs of a plane sweep against a scalar version in double precision.
#include "geometry/plane_sweep.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "catch.h"
#include "geometry/ray_votes.h"
#include "geometry/stereo.h"
#include "geometry/sweep_cost.h"
#include "geometry/sweep_rule.h"
#include "vector_targets.h"

using namespace stgs::encoder::geometry;

namespace {

struct Image {
  int width, height;
  std::vector<std::uint8_t> grey;
  double at(int x, int y) const {
    const int px = std::clamp(x, 0, width - 1), py = std::clamp(y, 0, height - 1);
    return grey[static_cast<std::size_t>(py) * width + px];
  }
  double between(double u, double v) const {
    const double x = std::clamp(u, 0.0, width - 1.0), y = std::clamp(v, 0.0, height - 1.0);
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const double above = at(x0, y0) + (x - x0) * (at(x0 + 1, y0) - at(x0, y0));
    const double below = at(x0, y0 + 1) + (x - x0) * (at(x0 + 1, y0 + 1) - at(x0, y0 + 1));
    return above + (y - y0) * (below - above);
  }
};

Image noise(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  Image out{width, height, {}};
  for (int i = 0; i < width * height; ++i)
    out.grey.push_back(static_cast<std::uint8_t>(random() % 200));
  return out;
}

struct Point {
  double x, y, z;
};

Point mapped(const float (&h)[9], double x, double y) {
  const double z = h[6] * x + h[7] * y + h[8];
  return {(h[0] * x + h[1] * y + h[2]) / z, (h[3] * x + h[4] * y + h[5]) / z, z};
}

// The cost of a pixel, or a negative number where the source does not see it.
double cost_of(const Image& a, const Image& b, const std::vector<std::uint32_t>& usable,
               const float (&h)[9], int window, int x, int y) {
  const Point centre = mapped(h, x, y);
  const int px = static_cast<int>(std::floor(centre.x + 0.5));
  const int py = static_cast<int>(std::floor(centre.y + 0.5));
  if (centre.z <= 0 || px < 0 || py < 0 || px >= b.width || py >= b.height) return -1;
  if (!usable.empty() && usable[static_cast<std::size_t>(py) * b.width + px] == 0) return -1;
  double sa = 0, saa = 0, sb = 0, sbb = 0, sab = 0;
  for (int dy = -window / 2; dy <= window / 2; ++dy) {
    for (int dx = -window / 2; dx <= window / 2; ++dx) {
      const int qx = std::clamp(x + dx, 0, a.width - 1), qy = std::clamp(y + dy, 0, a.height - 1);
      const Point p = mapped(h, qx, qy);
      const double va = a.at(qx, qy), vb = b.between(p.x, p.y);
      sa += va, saa += va * va, sb += vb, sbb += vb * vb, sab += va * vb;
    }
  }
  const double n = window * window;
  const double ma = sa / n, mb = sb / n;
  const double spread = (saa / n - ma * ma + 6) * (sbb / n - mb * mb + 6);
  const double correlation = (sab / n - ma * mb) / std::sqrt(spread);
  const double colour =
      0.5 * (std::abs(ma - mb) + std::abs(a.at(x, y) - b.between(centre.x, centre.y)));
  return std::clamp(0.65 * std::min(1.0, 1 - correlation) + 0.35 * std::min(1.0, colour / 48), 0.0,
                    1.0);
}

// The costs of sweep_cost.h, 1 where the source does not see the pixel.
std::vector<float> plain_costs(const Image& a, const SweepSource& source,
                               const SweepMapping& mapping, const float (&last)[3]) {
  constexpr int kReach = kSweepWindow / 2;
  const int pitch = a.width + 2 * kReach, rows = a.height + 2 * kReach;
  const auto position = [&](int x, int y) {
    return sweep_position(mapping, last, source.width, source.height, static_cast<float>(x),
                          static_cast<float>(y));
  };
  std::vector<float> own, warped, out;
  for (int i = 0; i < pitch * rows; ++i) {
    const int x = std::clamp(i % pitch - kReach, 0, a.width - 1);
    const int y = std::clamp(i / pitch - kReach, 0, a.height - 1);
    own.push_back(static_cast<float>(a.at(x, y)));
    warped.push_back(grey_between(source.corners, source.width, source.height, position(x, y)));
  }
  for (int y = 0; y < a.height; ++y) {
    for (int x = 0; x < a.width; ++x) {
      const int corner = y * pitch + x, middle = corner + kReach * pitch + kReach;
      const SweepPosition at = position(x, y);
      out.push_back(1);
      if (!at.seen || !is_usable(source.usable, source.width, source.height, at)) continue;
      const WindowSums means = window_means(&own[corner], &own[corner], pitch);
      out.back() = sweep_cost({own[middle], means.value, variance_of(means)}, warped[middle],
                              window_means(&warped[corner], &own[corner], pitch));
    }
  }
  return out;
}

}  // namespace

TEST_CASE("vectors give the costs of a plane sweep", "[sweep]") {
  const int width = GENERATE(1, 15, 16, 17, 61), window = GENERATE(1, 5);
  const bool is_masked = GENERATE(false, true);
  const Image a = noise(width, 13, 1), b = noise(40, 29, 2), c = noise(33, 31, 3);
  std::vector<std::uint32_t> usable;
  if (is_masked)
    for (std::size_t i = 0; i < b.grey.size(); ++i) usable.push_back(i % 3 == 0 ? 0 : 255);
  const float first[9] = {0.9f, 0.05f, -3.2f, -0.04f, 1.1f, 2.3f, 1e-3f, -2e-3f, 1.0f};
  const float second[9] = {1.05f, 0, -1.7f, 0.02f, 0.95f, -1.4f, 0, 1e-3f, 1.0f};
  const std::vector<std::uint32_t> in_b = corners_of(b.grey.data(), b.width, b.height),
                                   in_c = corners_of(c.grey.data(), c.width, c.height);
  const SweepSource one{in_b.data(), is_masked ? usable.data() : nullptr, b.width, b.height};
  const SweepSource two{in_c.data(), nullptr, c.width, c.height};
  stgs::testing::for_each_vector_target([&] {
    const SweepReference reference =
        make_sweep_reference({a.grey.begin(), a.grey.end()}, width, 13, window);
    PlaneCosts costs;
    reset(reference, &costs);
    add_source(reference, one, first, &costs);
    add_source(reference, two, second, &costs);
    for (int y = 0; y < 13; ++y) {
      for (int x = 0; x < width; ++x) {
        const double in_one = cost_of(a, b, usable, first, window, x, y);
        const double in_two = cost_of(a, c, {}, second, window, x, y);
        const std::size_t at = static_cast<std::size_t>(y) * reference.pitch + x;
        const double p = in_one < 0 ? 1 : in_one, q = in_two < 0 ? 1 : in_two;
        CHECK(costs.seen[at] == (in_one < 0 ? 0 : 1) + (in_two < 0 ? 0 : 1));
        CHECK(costs.first[at] == Approx(std::min(p, q)).margin(1e-3));
        CHECK(costs.second[at] == Approx(std::max(p, q)).margin(1e-3));
      }
    }
  });
}

TEST_CASE("a mask changes no cost inside of it", "[sweep]") {
  const int width = 61, height = 13, window = GENERATE(1, 5);
  const Image a = noise(width, height, 1), b = noise(40, 29, 2);
  const std::vector<std::uint32_t> corners = corners_of(b.grey.data(), b.width, b.height);
  const SweepSource source{corners.data(), nullptr, b.width, b.height};
  const float h[9] = {0.6f, 0.05f, 0.2f, -0.04f, 1.1f, 2.3f, 1e-3f, -2e-3f, 1.0f};
  // Rows without a pixel, with one at each border, and with some inside.
  std::vector<std::uint8_t> mask(static_cast<std::size_t>(width) * height, 0);
  const auto set = [&](int x, int y) { mask[static_cast<std::size_t>(y) * width + x] = 255; };
  set(0, 3), set(60, 4), set(31, 8), set(32, 8), set(15, 9), set(48, 12);
  stgs::testing::for_each_vector_target([&] {
    const auto costs_of = [&](const std::uint8_t* wanted) {
      const SweepReference reference = make_sweep_reference({a.grey.begin(), a.grey.end()}, width,
                                                            height, window, wanted, width);
      PlaneCosts costs;
      reset(reference, &costs);
      for (int k = 0; k < 3; ++k) add_source(reference, source, h, &costs);
      std::vector<std::uint8_t> out(mask.size());
      volume_costs(reference, costs, out.data());
      return out;
    };
    const std::vector<std::uint8_t> all = costs_of(nullptr), masked = costs_of(mask.data());
    for (std::size_t i = 0; i < mask.size(); ++i)
      if (mask[i] != 0) CHECK(masked[i] == all[i]);
  });
}

TEST_CASE("costs of a volume are those of the scalar rule", "[sweep]") {
  const int width = 37, height = 3;
  const SweepReference reference =
      make_sweep_reference(std::vector<float>(width * height, 9.0f), width, height, 1);
  PlaneCosts costs;
  reset(reference, &costs);
  std::mt19937 random(5);
  std::uniform_real_distribution<float> cost(0.0f, 1.0f);
  for (std::size_t i = 0; i < costs.first.size(); ++i) {
    costs.first[i] = cost(random);
    costs.second[i] = std::max(costs.first[i], cost(random));
    costs.seen[i] = static_cast<float>(random() % 5);
  }
  stgs::testing::for_each_vector_target([&] {
    std::vector<std::uint8_t> out(static_cast<std::size_t>(width) * height);
    volume_costs(reference, costs, out.data());
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const std::size_t at = static_cast<std::size_t>(y) * reference.pitch + x;
        const int expected = volume_cost(costs.first[at], costs.second[at], costs.seen[at]);
        // Rounding decides between two levels.
        CHECK(std::abs(out[static_cast<std::size_t>(y) * width + x] - expected) <= 1);
      }
    }
  });
}

TEST_CASE("the rule of CUDA gives the costs of vectors to the bit", "[sweep]") {
  const int width = 61, height = 47;
  const Image a = noise(width, height, 1), b = noise(40, 29, 2);
  const std::vector<std::uint32_t> corners = corners_of(b.grey.data(), b.width, b.height);
  std::vector<std::uint32_t> usable;
  for (std::size_t i = 0; i < b.grey.size(); ++i) usable.push_back(i % 7 == 0 ? 0 : 255);
  // The second maps rows to rows, as cameras beside each other do.
  const SweepMapping mapping = GENERATE(
      SweepMapping{
          {0.63f, -0.04f, 1e-3f}, {0.05f, 0.64f, -2e-3f}, {-3.2, 2.3, 1.0}, {0.9, -0.7, 0.1}},
      SweepMapping{{1, 0, 0}, {0, 1, 0}, {-7.3, -9, 1}, {-4.9, 0, 0}});
  const SweepSource source{corners.data(), usable.data(), b.width, b.height};
  // The fewest pixels that differ: without fused multiply-add, rounding differs.
  std::size_t least = a.grey.size();
  stgs::testing::for_each_vector_target([&] {
    const SweepReference reference =
        make_sweep_reference({a.grey.begin(), a.grey.end()}, width, height, kSweepWindow);
    PlaneCosts costs;
    std::size_t different = 0;
    for (int plane = 0; plane < 9; ++plane) {
      const double inverse = 0.1 * plane;
      float last[3];
      for (int row = 0; row < 3; ++row) last[row] = last_column(mapping, row, inverse);
      const float h[9] = {mapping.x[0], mapping.y[0], last[0],      mapping.x[1], mapping.y[1],
                          last[1],      mapping.x[2], mapping.y[2], last[2]};
      reset(reference, &costs);
      add_source(reference, source, h, &costs);
      const std::vector<float> expected = plain_costs(a, source, mapping, last);
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const float cost = costs.first[static_cast<std::size_t>(y) * reference.pitch + x];
          different += cost == expected[static_cast<std::size_t>(y) * width + x] ? 0 : 1;
        }
      }
    }
    least = std::min(least, different);
  });
  CHECK(least == 0);
}

TEST_CASE("behind the source nothing is seen", "[sweep]") {
  const Image image = noise(20, 10, 4);
  const SweepReference reference =
      make_sweep_reference({image.grey.begin(), image.grey.end()}, 20, 10, 5);
  const std::vector<std::uint32_t> corners = corners_of(image.grey.data(), 20, 10);
  const float away[9] = {-1, 0, 0, 0, -1, 0, 0, 0, -1};
  PlaneCosts costs;
  reset(reference, &costs);
  add_source(reference, {corners.data(), nullptr, 20, 10}, away, &costs);
  CHECK(std::all_of(costs.seen.begin(), costs.seen.end(), [](float seen) { return seen == 0; }));
  CHECK(std::all_of(costs.first.begin(), costs.first.end(), [](float cost) { return cost == 1; }));
}

TEST_CASE("vectors give the votes about the points of a ray", "[sweep]") {
  const std::size_t count = GENERATE(0, 1, 3, 4, 5, 16, 17);
  const int width = 24, height = 18;
  std::mt19937 random(6);
  std::uniform_real_distribution<float> depth(1.0f, 4.0f);
  std::vector<float> hiding;
  for (int i = 0; i < width * height; ++i)
    hiding.push_back(i % 3 == 0 ? -depth(random) : depth(random));
  const VotingView view{hiding.data(),        width,           height, 20, 21, 12, 9,
                        {-0.4f, 0.1f, -0.2f}, {0.3f, 0.05f, 1}};
  std::vector<float> depths;
  for (std::size_t k = 0; k < count; ++k) depths.push_back(0.1f + 0.23f * static_cast<float>(k));
  stgs::testing::for_each_vector_target([&] {
    RayVotes votes(depths);
    REQUIRE(votes.count == count);
    for (int pass = 1; pass <= 2; ++pass) {
      add_votes(view, 0.4f, &votes);
      for (std::size_t k = 0; k < count; ++k) {
        float at[3];
        for (int i = 0; i < 3; ++i) at[i] = view.start[i] + depths[k] * view.along[i];
        const float u = at[0] / at[2] * view.fx + view.cx, v = at[1] / at[2] * view.fy + view.cy;
        const bool is_in_image = at[2] >= 0.4f && u >= 0 && v >= 0 &&
                                 u < static_cast<float>(width) && v < static_cast<float>(height);
        const float limit =
            is_in_image ? hiding[static_cast<std::size_t>(v) * width + static_cast<std::size_t>(u)]
                        : 0;
        const bool is_visible = is_in_image && at[2] <= std::abs(limit);
        CHECK(votes.inside[k] == (is_visible && limit < 0 ? static_cast<float>(pass) : 0));
        CHECK(votes.outside[k] == (is_visible && limit >= 0 ? static_cast<float>(pass) : 0));
      }
    }
  });
}
