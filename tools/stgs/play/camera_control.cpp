// SPDX-License-Identifier: Apache-2.0
#include "play/camera_control.h"

#include <algorithm>
#include <cmath>

#include "camera_axes.h"

namespace stgs::tools {
namespace {

constexpr double kMaxElevation = 1.5;                       // radians from the horizon
constexpr double kMinDistance = 1e-3, kMaxDistance = 1e18;  // to the target, scene units
constexpr double kOverviewDistance = 1.2;  // in scene diagonals: fits the scene to the height
constexpr int kOverviewWidth = 1280, kOverviewHeight = 720;

Vector3 vector_of(const float (&v)[3]) {
  return {v[0], v[1], v[2]};
}

Vector3 centre(const stgs_scene_info& scene) {
  return 0.5 * (vector_of(scene.bounds_min) + vector_of(scene.bounds_max));
}

double diagonal(const stgs_scene_info& scene) {
  return length(vector_of(scene.bounds_max) - vector_of(scene.bounds_min));
}

void set_pose(encoder::Camera& camera, const Vector3 (&axes)[3], const Vector3& position) {
  for (int row = 0; row < 3; ++row) {
    camera.rotation[3 * row] = axes[row].x;
    camera.rotation[3 * row + 1] = axes[row].y;
    camera.rotation[3 * row + 2] = axes[row].z;
    camera.translation[row] = -dot(axes[row], position);
  }
}

}  // namespace

CameraControl::CameraControl(const encoder::Camera& start, const stgs_scene_info& scene)
    : start_(start), now_(start) {
  const Vector3 up = vector_of(scene.up);
  up_ = length(up) > 0.5 ? unit(up) : -1 * axis(1);
  const Vector3 position = position_of(start);
  start_distance_ = dot(axis(2), centre(scene) - position);
  const double size = diagonal(scene);
  if (!(start_distance_ > 0.01 * size)) start_distance_ = std::max(0.5 * size, kMinDistance);
  start_target_ = position + start_distance_ * axis(2);
  target_ = start_target_;
  distance_ = start_distance_;
}

Vector3 CameraControl::axis(int row) const {
  return axis_of(now_, row);
}

Vector3 CameraControl::position() const {
  return target_ - distance_ * axis(2);
}

void CameraControl::set_position(const Vector3& position) {
  const Vector3 axes[3] = {axis(0), axis(1), axis(2)};
  set_pose(now_, axes, position);
}

void CameraControl::rotate(double right, double up) {
  const double level = std::asin(std::clamp(dot(axis(2), up_), -1.0, 1.0));
  const double steepest = std::max(kMaxElevation, std::abs(level));
  up = std::clamp(level + up, -steepest, steepest) - level;
  const Vector3 across = axis(0);
  Vector3 axes[3];
  for (int row = 1; row < 3; ++row) {
    axes[row] = rotated(rotated(axis(row), across, up), up_, -right);
  }
  // Orthonormalise, so that rounding errors do not accumulate over thousands of small rotations.
  axes[2] = unit(axes[2]);
  axes[1] = unit(axes[1] - dot(axes[1], axes[2]) * axes[2]);
  axes[0] = cross(axes[1], axes[2]);
  set_pose(now_, axes, position_of(now_));
}

void CameraControl::orbit(double right, double up) {
  // The opposite rotation keeps the target on the optical axis.
  rotate(-right, -up);
  set_position(position());
}

void CameraControl::look(double right, double up) {
  const Vector3 fixed = position();
  rotate(right, up);
  target_ = fixed + distance_ * axis(2);
  set_position(fixed);
}

void CameraControl::move(double right, double up, double forward) {
  target_ = target_ + right * axis(0) - up * axis(1) + forward * axis(2);
  set_position(position());
}

void CameraControl::approach(double factor) {
  distance_ = std::clamp(distance_ * factor, kMinDistance, kMaxDistance);
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

encoder::Camera overview(const stgs_scene_info& scene) {
  const Vector3 known = vector_of(scene.up);
  const Vector3 down = length(known) > 0.5 ? -1 * unit(known) : Vector3{0, 1, 0};
  const Vector3 seed = std::abs(down.z) < 0.9 ? Vector3{0, 0, 1} : Vector3{0, 1, 0};
  const Vector3 right = unit(cross(down, seed));
  const Vector3 axes[3] = {right, down, cross(right, down)};
  encoder::Camera camera;
  camera.name = "overview";
  camera.width = kOverviewWidth;
  camera.height = kOverviewHeight;
  camera.fx = camera.fy = kOverviewHeight;
  camera.cx = 0.5 * kOverviewWidth;
  camera.cy = 0.5 * kOverviewHeight;
  const double back = std::max(kOverviewDistance * diagonal(scene), kMinDistance);
  set_pose(camera, axes, centre(scene) - back * axes[2]);
  return camera;
}

}  // namespace stgs::tools
