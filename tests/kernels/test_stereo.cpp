// SPDX-License-Identifier: Apache-2.0
// Multi-view stereo: the cost of a plane, and depth and normals of a rendered scene.
#include "geometry/stereo.h"

#include <cmath>

#include "catch.h"
#include "geometry/stereo_rows.h"

using namespace stgs;
using namespace stgs::encoder;
using namespace stgs::encoder::geometry;

namespace {

constexpr int kWidth = 96, kHeight = 72;

// A texture without repetition, 0 to 255, over a plane's coordinates.
float texture(float x, float y) {
  float value = 0.0f;
  for (int k = 1; k <= 6; ++k) {
    const float f = 1.7f * static_cast<float>(k);
    value += std::sin(f * x + 1.3f * static_cast<float>(k * k)) *
             std::cos(0.8f * f * y + 2.1f * static_cast<float>(k));
  }
  return 127.5f + 40.0f * value;
}

struct Hit {
  float depth;
  Vec3 normal;
  float value;
};

// A slanted wall, and a square in front of it.
Hit cast(Vec3 origin, Vec3 ray) {
  const Vec3 wall = {0.3f, 0.1f, -1.0f};
  const float at = (-4.0f - math::dot3(wall, origin)) / math::dot3(wall, ray);
  const Vec3 p = math::vec3_add(origin, math::vec3_scale(ray, at));
  const float near = (2.5f - origin.z) / ray.z;
  const Vec3 q = math::vec3_add(origin, math::vec3_scale(ray, near));
  if (std::abs(q.x - 0.2f) < 0.4f && std::abs(q.y) < 0.4f)
    return {near, {0.0f, 0.0f, -1.0f}, texture(3.0f * q.x + 9.0f, 3.0f * q.y)};
  return {at, math::vec3_scale(wall, 1.0f / std::sqrt(math::dot3(wall, wall))),
          texture(2.0f * p.x, 2.0f * p.y)};
}

// A camera at (x, y, 0) that looks at (0, 0, 4).
StereoView view_at(float x, float y) {
  StereoView view;
  view.width = kWidth;
  view.height = kHeight;
  view.fx = view.fy = 90.0f;
  view.cx = 0.5f * kWidth;
  view.cy = 0.5f * kHeight;
  const Vec3 centre = {x, y, 0.0f};
  const float length = std::sqrt(x * x + y * y + 16.0f);
  const Vec3 f = {-x / length, -y / length, 4.0f / length};
  const float across = std::sqrt(f.x * f.x + f.z * f.z);
  const Vec3 right = {f.z / across, 0.0f, -f.x / across};
  const Vec3 down = {f.y * right.z - f.z * right.y, f.z * right.x - f.x * right.z,
                     f.x * right.y - f.y * right.x};
  view.rotation = {right.x, right.y, right.z, down.x, down.y, down.z, f.x, f.y, f.z};
  const Vec3 moved = math::mat3_mul(view.rotation, centre);
  view.translation = {-moved.x, -moved.y, -moved.z};
  for (int py = 0; py < kHeight; ++py) {
    for (int px = 0; px < kWidth; ++px) {
      const Vec3 ray = {(static_cast<float>(px) + 0.5f - view.cx) / view.fx,
                        (static_cast<float>(py) + 0.5f - view.cy) / view.fy, 1.0f};
      const Hit hit = cast(centre, math::mat3_transpose_mul(view.rotation, ray));
      view.grey.push_back(
          static_cast<std::uint8_t>(std::fmin(std::fmax(hit.value, 0.0f), 255.0f) + 0.5f));
    }
  }
  return view;
}

std::vector<StereoView> rig() {
  std::vector<StereoView> views;
  for (const float x : {-1.2f, -0.4f, 0.4f, 1.2f}) views.push_back(view_at(x, 0.3f * x * x));
  for (int i = 0; i < 4; ++i) {
    for (const int step : {-1, 1, -2, 2}) {
      if (i + step >= 0 && i + step < 4)
        views[static_cast<std::size_t>(i)].sources.push_back(i + step);
    }
  }
  return views;
}

bool in_order(int count, const std::function<void(int)>& task) {
  for (int i = 0; i < count; ++i) task(i);
  return true;
}

constexpr StereoSettings kRange{1.5f, 8.0f, 2, 1};

}  // namespace

TEST_CASE("stereo finds depth and normals of slanted surfaces at their edges") {
  const std::vector<StereoView> views = rig();
  const std::vector<StereoMap> maps = match_views(views, kRange, in_order);
  REQUIRE(maps.size() == views.size());
  int confirmed = 0, deep = 0, turned = 0, pixels = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const StereoView& view = views[i];
    const Vec3 back = math::mat3_transpose_mul(view.rotation, view.translation);
    const Vec3 centre = {-back.x, -back.y, -back.z};
    for (int y = 8; y < kHeight - 8; ++y) {
      for (int x = 8; x < kWidth - 8; ++x) {
        const std::size_t at = static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
        ++pixels;
        if (maps[i].confirmations[at] == 0) continue;
        ++confirmed;
        const Vec3 ray = {(static_cast<float>(x) + 0.5f - view.cx) / view.fx,
                          (static_cast<float>(y) + 0.5f - view.cy) / view.fy, 1.0f};
        const Hit hit = cast(centre, math::mat3_transpose_mul(view.rotation, ray));
        const Hypothesis& plane = maps[i].planes[at];
        const Vec3 normal = math::mat3_transpose_mul(view.rotation, plane.normal);
        deep += std::abs(plane.depth - hit.depth) < 0.02f * hit.depth ? 1 : 0;
        turned += math::dot3(normal, hit.normal) > 0.94f ? 1 : 0;  // 20 degrees
      }
    }
  }
  CHECK(confirmed > 0.7 * pixels);
  CHECK(deep > 0.96 * confirmed);
  CHECK(turned > 0.8 * confirmed);
}

TEST_CASE("costs of a support do not depend on vectors") {
  // A map of one pass has the costs of the vectorised rows; each is computed again without vectors.
  std::vector<StereoView> views = rig();
  const std::vector<StereoMap> maps = match_views(views, kRange, in_order);
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
  for (const StereoMap& map : match_views(views, kRange, in_order)) {
    for (const std::uint8_t count : map.confirmations) confirmed += count > 0 ? 1 : 0;
  }
  CHECK(confirmed < 0.002 * 4 * kWidth * kHeight);
}

TEST_CASE("stereo stops if it is cancelled") {
  int calls = 0;
  const auto twice = [&](int count, const std::function<void(int)>& task) {
    return ++calls <= 2 && in_order(count, task);
  };
  CHECK(match_views(rig(), kRange, twice).empty());
  CHECK(calls == 3);
  calls = -kStereoLoops;
  CHECK_FALSE(match_views(rig(), kRange, twice).empty());
  CHECK(calls == 0);
}
