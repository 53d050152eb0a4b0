// SPDX-License-Identifier: Apache-2.0
#include "train/free_space.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "math/grad.h"
#include "train/initial_points.h"
#include "train/rig.h"

namespace stgs::encoder {
namespace {

using math::dot3;
using math::Vec3;
using math::vec3_add;
using math::vec3_scale;

// Part of the depth of the nearest content that is taken to be empty.
constexpr float kEmptyShare = 0.5f;
constexpr float kMarginShare = 0.15f;  // of the empty depth
// Content is as near as this quantile of the depths of the points in the view. That of moving
// content, which comes near a camera for a few frames, is smaller.
constexpr double kStaticQuantile = 0.01, kDynamicQuantile = 0.002;
constexpr std::size_t kMinPoints = 50;  // static ones, in the view
constexpr double kMaxPairAngle = 50;    // of cameras with a view between them, degrees
constexpr int kPairs = 2;               // views between a camera and others, at most

Vec3 unit(Vec3 v) {
  return vec3_scale(v, 1.0f / std::sqrt(dot3(v, v)));
}

Vec3 difference(Vec3 a, Vec3 b) {
  return vec3_add(a, vec3_scale(b, -1.0f));
}

Vec3 vector(const double* v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

// The middle of the arc around `scene` between two positions.
Vec3 middle(Vec3 a, Vec3 b, Vec3 scene) {
  const Vec3 from_a = difference(a, scene), from_b = difference(b, scene);
  const float radius = 0.5f * (std::sqrt(dot3(from_a, from_a)) + std::sqrt(dot3(from_b, from_b)));
  return vec3_add(scene, vec3_scale(unit(vec3_add(unit(from_a), unit(from_b))), radius));
}

// A camera between two, turned halfway.
Camera between(const Camera& a, const Camera& b, const double scene[3]) {
  const auto row = [&](int r) {
    return vec3_add(vector(a.rotation + 3 * r), vector(b.rotation + 3 * r));
  };
  const Vec3 z = unit(row(2));
  const Vec3 x = unit(difference(row(0), vec3_scale(z, dot3(row(0), z))));
  const Vec3 y = {z.y * x.z - z.z * x.y, z.z * x.x - z.x * x.z, z.x * x.y - z.y * x.x};
  const Vec3 centre = middle(vector(rig_pose(a).centre), vector(rig_pose(b).centre), vector(scene));
  Camera camera = a;
  const Vec3 axes[3] = {x, y, z};
  for (int r = 0; r < 3; ++r) {
    camera.rotation[3 * r] = axes[r].x;
    camera.rotation[3 * r + 1] = axes[r].y;
    camera.rotation[3 * r + 2] = axes[r].z;
    camera.translation[r] = -dot3(axes[r], centre);
  }
  return camera;
}

// The training cameras, then those between neighbours, nearest pairs first.
std::vector<Camera> views_of(const PreparedCapture& capture) {
  std::vector<Camera> views = capture.training_cameras();
  const std::vector<RigPose> poses = training_poses(capture);
  using Pair = std::tuple<double, std::size_t, std::size_t>;
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    std::vector<Pair> own;
    for (std::size_t j = 0; j < poses.size(); ++j) {
      const double angle = rig_angle(poses[i], poses[j], capture.scene_centre);
      if (j != i && angle < kMaxPairAngle) own.emplace_back(angle, std::min(i, j), std::max(i, j));
    }
    std::sort(own.begin(), own.end());
    own.resize(std::min<std::size_t>(own.size(), kPairs));
    pairs.insert(pairs.end(), own.begin(), own.end());
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  for (const auto& [angle, i, j] : pairs) {
    const Camera camera = between(views[i], views[j], capture.scene_centre);
    // Not a number if a camera is at the centre, or two are rolled by half a turn.
    if (std::isfinite(camera.translation[0] + camera.rotation[0] + camera.rotation[8]))
      views.push_back(camera);
  }
  if (views.size() > kMaxEmptyViews) views.resize(kMaxEmptyViews);
  return views;
}

// The quantile of the depths of the points that the camera sees; infinite for fewer than `least`.
float near_depth(const math::PinholeCamera& camera, const std::vector<InitialPoint>& points,
                 double quantile, std::size_t least) {
  std::vector<float> depths;
  for (const InitialPoint& point : points) {
    const math::Vec3 p =
        math::to_camera(camera, {point.position[0], point.position[1], point.position[2]});
    if (!(p.z > 0)) continue;
    const float u = camera.fx * p.x / p.z + camera.cx, v = camera.fy * p.y / p.z + camera.cy;
    if (u >= 0 && v >= 0 && u < camera.width && v < camera.height) depths.push_back(p.z);
  }
  if (depths.size() < least) return INFINITY;
  const auto at = depths.begin() +
                  static_cast<std::ptrdiff_t>(quantile * static_cast<double>(depths.size() - 1));
  std::nth_element(depths.begin(), at, depths.end());
  return *at;
}

}  // namespace

Result<FreeSpace> find_free_space(const PreparedCapture& capture) {
  FreeSpace space;
  if (!(rig_sparsity(capture) > 0)) return space;
  STGS_ASSIGN(InitialPoints points, read_initial_points(capture));
  std::erase_if(points.statics, [vicinity = vicinity_of(capture)](const InitialPoint& point) {
    return is_far(vicinity, point.position);
  });
  for (const Camera& camera : views_of(capture)) {
    const math::PinholeCamera pinhole = camera.pinhole(0.0f);
    const float background = near_depth(pinhole, points.statics, kStaticQuantile, kMinPoints);
    if (!std::isfinite(background)) continue;
    const float nearest =
        std::min(background, near_depth(pinhole, points.dynamics, kDynamicQuantile, 1));
    EmptyView& view = space.views[space.count++];
    view.rotation = pinhole.rotation;
    view.translation = pinhole.translation;
    view.tan_x = 0.5f * pinhole.width / pinhole.fx;
    view.tan_y = 0.5f * pinhole.height / pinhole.fy;
    view.depth = kEmptyShare * nearest;
    view.margin = kMarginShare * view.depth;
  }
  return space;
}

std::string fingerprint_of(const FreeSpace& space) {
  return fmt::format(
      "{:016x}",
      XXH3_64bits(space.views, sizeof(EmptyView) * static_cast<std::size_t>(space.count)));
}

}  // namespace stgs::encoder
