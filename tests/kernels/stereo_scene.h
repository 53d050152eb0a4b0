// SPDX-License-Identifier: Apache-2.0
// A rendered scene for multi-view stereo: a slanted wall and a square in front of it.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "geometry/stereo.h"

namespace stgs::testing {

using namespace encoder::geometry;

inline constexpr int kWidth = 96, kHeight = 72;

// A texture without repetition, 0 to 255, over a plane's coordinates.
inline float texture(float x, float y) {
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

inline Hit cast(Vec3 origin, Vec3 ray) {
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
inline StereoView view_at(float x, float y) {
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

inline std::vector<StereoView> rig() {
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

// Returns the pose of source j of view i, without its image.
inline StereoSource source_of(const std::vector<StereoView>& views, std::size_t i, std::size_t j) {
  return posed_source({}, views[i].rotation, views[i].translation, views[j].rotation,
                      views[j].translation);
}

inline constexpr StereoSettings kRange{1.5f, 8.0f, 2, 1};

inline Status in_order(int count, const std::function<Status(int)>& task) {
  for (int i = 0; i < count; ++i) STGS_TRY(task(i));
  return {};
}

// Returns no maps on an error.
inline std::vector<StereoMap> matched(const std::vector<StereoView>& views, ViewMatcher& matcher) {
  Result<std::vector<StereoMap>> maps = match_views(views, kRange, matcher, in_order);
  return maps.ok() ? std::move(*maps) : std::vector<StereoMap>();
}

// A pass over view 1 against the others, which compares the depths of their maps.
struct Pass {
  std::vector<std::vector<std::uint32_t>> corners;
  std::vector<std::vector<float>> depths;
  StereoProblem problem{};

  Pass(const std::vector<StereoView>& views, const std::vector<StereoMap>& maps) {
    for (std::size_t i = 0; i < views.size(); ++i) {
      corners.push_back(corners_of(views[i].grey.data(), kWidth, kHeight));
      depths.emplace_back();
      for (const Hypothesis& plane : maps[i].planes) depths.back().push_back(plane.depth);
    }
    const auto image = [&](std::size_t i) {
      const StereoView& v = views[i];
      return StereoImage{
          corners[i].data(), depths[i].data(), kWidth, kHeight, v.fx, v.fy, v.cx, v.cy};
    };
    problem.reference = image(1);
    problem.nearest = kRange.nearest;
    problem.farthest = kRange.farthest;
    problem.consistency = 0.05f;
    for (const std::size_t j : {0, 2, 3}) {
      StereoSource source = source_of(views, 1, j);
      source.image = image(j);
      problem.sources[problem.source_count++] = derived_source(problem.reference, source);
    }
  }

  // Returns the share of pixels whose cost is not that of their plane, by the scalar reference.
  double share_of_wrong_costs(const PlaneMap& map) const {
    int wrong = 0;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const std::size_t at = pixel_index(problem, x, y);
        Support support{};
        load_support(problem.reference, x, y, &support);
        const float cost = hypothesis_cost(problem, support, x, y, map.planes[at]);
        wrong += std::abs(cost - map.costs[at]) > 2e-3f ? 1 : 0;
      }
    }
    return double(wrong) / (kWidth * kHeight);
  }
};

// Shares of the pixels away from the borders.
struct Accuracy {
  double confirmed = 0;         // of all
  double deep = 0, turned = 0;  // of the confirmed: depth within 2 %, normal within 20 degrees
};

inline Accuracy accuracy_of(const std::vector<StereoView>& views,
                            const std::vector<StereoMap>& maps) {
  if (maps.size() != views.size()) return {};
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
  return {double(confirmed) / pixels, double(deep) / confirmed, double(turned) / confirmed};
}

}  // namespace stgs::testing
