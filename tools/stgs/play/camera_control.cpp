// SPDX-License-Identifier: Apache-2.0
#include "play/camera_control.h"

#include <algorithm>
#include <cmath>

#include "stgs/format/math/surface.h"

namespace stgs::tools {
namespace {

using math::Vec3;

constexpr double kMaxElevation = 1.5;      // radians from the horizon
constexpr double kMinDistance = 1e-3;      // to the target, scene units
constexpr double kOverviewDistance = 1.2;  // in scene diagonals: fits the scene to the height
constexpr int kOverviewWidth = 1280, kOverviewHeight = 720;

Vec3 sum(Vec3 a, Vec3 b, double factor = 1) {
  const auto f = static_cast<float>(factor);
  return {a.x + f * b.x, a.y + f * b.y, a.z + f * b.z};
}

double length(Vec3 v) {
  return std::sqrt(static_cast<double>(math::dot3(v, v)));
}

Vec3 unit(Vec3 v) {
  const auto n = static_cast<float>(1 / length(v));
  return {n * v.x, n * v.y, n * v.z};
}

// Rotates v about a unit axis (Rodrigues).
Vec3 rotated(Vec3 v, Vec3 about, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  const double along = (1 - c) * static_cast<double>(math::dot3(about, v));
  return sum(sum(sum({0, 0, 0}, v, c), math::cross3(about, v), s), about, along);
}

Vec3 centre(const SceneMetadata& scene) {
  const auto mean = [&](int k) { return 0.5f * (scene.bounds_min[k] + scene.bounds_max[k]); };
  return {mean(0), mean(1), mean(2)};
}

double diagonal(const SceneMetadata& scene) {
  const Vec3 low{scene.bounds_min[0], scene.bounds_min[1], scene.bounds_min[2]};
  return length(sum({scene.bounds_max[0], scene.bounds_max[1], scene.bounds_max[2]}, low, -1));
}

Vec3 position_of(const encoder::Camera& camera) {
  return math::camera_centre(camera.pinhole(0));
}

void set_pose(encoder::Camera& camera, const Vec3 (&axes)[3], Vec3 position) {
  for (int row = 0; row < 3; ++row) {
    camera.rotation[3 * row] = axes[row].x;
    camera.rotation[3 * row + 1] = axes[row].y;
    camera.rotation[3 * row + 2] = axes[row].z;
    camera.translation[row] = -static_cast<double>(math::dot3(axes[row], position));
  }
}

}  // namespace

CameraControl::CameraControl(const encoder::Camera& start, const SceneMetadata& scene)
    : start_(start), now_(start) {
  const Vec3 up{scene.up[0], scene.up[1], scene.up[2]};
  up_ = length(up) > 0.5 ? unit(up) : sum({0, 0, 0}, axis(1), -1);
  const Vec3 position = position_of(start);
  start_distance_ = static_cast<double>(math::dot3(axis(2), sum(centre(scene), position, -1)));
  const double size = diagonal(scene);
  if (!(start_distance_ > 0.01 * size)) start_distance_ = std::max(0.5 * size, kMinDistance);
  start_target_ = sum(position, axis(2), start_distance_);
  target_ = start_target_;
  distance_ = start_distance_;
}

Vec3 CameraControl::axis(int row) const {
  const double* r = now_.rotation + 3 * row;
  return {static_cast<float>(r[0]), static_cast<float>(r[1]), static_cast<float>(r[2])};
}

Vec3 CameraControl::position() const {
  return sum(target_, axis(2), -distance_);
}

void CameraControl::set_position(Vec3 position) {
  const Vec3 axes[3] = {axis(0), axis(1), axis(2)};
  set_pose(now_, axes, position);
}

void CameraControl::rotate(double right, double up) {
  const double level =
      std::asin(std::clamp(static_cast<double>(math::dot3(axis(2), up_)), -1.0, 1.0));
  const double steepest = std::max(kMaxElevation, std::abs(level));
  up = std::clamp(level + up, -steepest, steepest) - level;
  const Vec3 across = axis(0);
  Vec3 axes[3];
  for (int row = 1; row < 3; ++row) {
    axes[row] = rotated(rotated(axis(row), across, up), up_, -right);
  }
  // Orthonormalise, so that rounding errors do not accumulate over thousands of small rotations.
  axes[2] = unit(axes[2]);
  axes[1] = unit(sum(axes[1], axes[2], -static_cast<double>(math::dot3(axes[1], axes[2]))));
  axes[0] = math::cross3(axes[1], axes[2]);
  set_pose(now_, axes, position_of(now_));
}

void CameraControl::orbit(double right, double up) {
  // The opposite rotation keeps the target on the optical axis.
  rotate(-right, -up);
  set_position(position());
}

void CameraControl::look(double right, double up) {
  const Vec3 fixed = position();
  rotate(right, up);
  target_ = sum(fixed, axis(2), distance_);
  set_position(fixed);
}

void CameraControl::move(double right, double up, double forward) {
  target_ = sum(sum(sum(target_, axis(0), right), axis(1), -up), axis(2), forward);
  set_position(position());
}

void CameraControl::approach(double factor) {
  distance_ = std::max(distance_ * factor, kMinDistance);
  set_position(position());
}

void CameraControl::reset() {
  now_ = start_;
  target_ = start_target_;
  distance_ = start_distance_;
}

encoder::Camera CameraControl::camera(Size size) const {
  const double x = static_cast<double>(size.width) / start_.width;
  const double y = static_cast<double>(size.height) / start_.height;
  const double scale = std::min(x, y);
  encoder::Camera camera = now_;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = 0.5 * size.width + (start_.cx - 0.5 * start_.width) * scale;
  camera.cy = 0.5 * size.height + (start_.cy - 0.5 * start_.height) * scale;
  return camera;
}

encoder::Camera overview(const SceneMetadata& scene) {
  const Vec3 known{scene.up[0], scene.up[1], scene.up[2]};
  const Vec3 down = length(known) > 0.5 ? sum({0, 0, 0}, unit(known), -1) : Vec3{0, 1, 0};
  const Vec3 seed = std::abs(down.z) < 0.9f ? Vec3{0, 0, 1} : Vec3{0, 1, 0};
  const Vec3 right = unit(math::cross3(down, seed));
  const Vec3 axes[3] = {right, down, math::cross3(right, down)};
  encoder::Camera camera;
  camera.name = "overview";
  camera.width = kOverviewWidth;
  camera.height = kOverviewHeight;
  camera.fx = camera.fy = kOverviewHeight;
  camera.cx = 0.5 * kOverviewWidth;
  camera.cy = 0.5 * kOverviewHeight;
  const double back = std::max(kOverviewDistance * diagonal(scene), kMinDistance);
  set_pose(camera, axes, sum(centre(scene), axes[2], -back));
  return camera;
}

}  // namespace stgs::tools
