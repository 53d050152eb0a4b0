// SPDX-License-Identifier: Apache-2.0
#include "train/free_space.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

#include "train/initial_points.h"
#include "train/rig.h"

namespace stgs::encoder {
namespace {

// Part of the depth of the nearest content that is taken to be empty.
constexpr float kEmptyShare = 0.5f;
constexpr float kMarginShare = 0.15f;  // of the empty depth
// Content is as near as this quantile of the depths of the points in the view. That of moving
// content, which comes near a camera for a few frames, is smaller.
constexpr double kStaticQuantile = 0.01, kDynamicQuantile = 0.002;
constexpr std::size_t kMinPoints = 50;  // static ones, in the view
constexpr double kMaxPairAngle = 50;    // of cameras with a view between them, degrees
constexpr int kPairs = 2;               // views between a camera and others, at most

struct Vector {
  double x[3];
};

double dot(const Vector& a, const Vector& b) {
  return a.x[0] * b.x[0] + a.x[1] * b.x[1] + a.x[2] * b.x[2];
}

Vector scaled(const Vector& a, double s) {
  return {{s * a.x[0], s * a.x[1], s * a.x[2]}};
}

Vector sum(const Vector& a, const Vector& b) {
  return {{a.x[0] + b.x[0], a.x[1] + b.x[1], a.x[2] + b.x[2]}};
}

Vector unit(const Vector& a) {
  return scaled(a, 1 / std::sqrt(dot(a, a)));
}

// The middle of the arc around `scene` between two positions.
Vector middle(const Vector& a, const Vector& b, const Vector& scene) {
  const Vector from_a = sum(a, scaled(scene, -1)), from_b = sum(b, scaled(scene, -1));
  const double radius = 0.5 * (std::sqrt(dot(from_a, from_a)) + std::sqrt(dot(from_b, from_b)));
  return sum(scene, scaled(unit(sum(unit(from_a), unit(from_b))), radius));
}

// A camera between two, turned halfway.
Camera between(const Camera& a, const Camera& b, const double scene[3]) {
  const auto row = [&](int r) {
    Vector mean{};
    for (int c = 0; c < 3; ++c) mean.x[c] = a.rotation[3 * r + c] + b.rotation[3 * r + c];
    return mean;
  };
  const Vector forward = unit(row(2));
  const Vector right = unit(sum(row(0), scaled(forward, -dot(row(0), forward))));
  const RigPose pa = rig_pose(a), pb = rig_pose(b);
  const auto vector = [](const double* p) { return Vector{{p[0], p[1], p[2]}}; };
  const Vector centre = middle(vector(pa.centre), vector(pb.centre), vector(scene));
  Camera camera = a;
  for (int c = 0; c < 3; ++c) {
    const int d = (c + 1) % 3, e = (c + 2) % 3;
    camera.rotation[c] = right.x[c];
    camera.rotation[3 + c] = forward.x[d] * right.x[e] - forward.x[e] * right.x[d];
    camera.rotation[6 + c] = forward.x[c];
  }
  for (int r = 0; r < 3; ++r) camera.translation[r] = -dot(vector(camera.rotation + 3 * r), centre);
  return camera;
}

// The training cameras, then those between neighbours, nearest pairs first.
std::vector<Camera> views_of(const PreparedCapture& capture) {
  std::vector<Camera> views;
  for (const Camera& camera : capture.cameras) {
    if (!camera.test) views.push_back(camera);
  }
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
  STGS_ASSIGN(const InitialPoints points, read_initial_points(capture));
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
