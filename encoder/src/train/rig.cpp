// SPDX-License-Identifier: Apache-2.0
#include "train/rig.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stgs::encoder {
namespace {

// Radius of the vicinity, relative to the extent of the rig and to the radius of the scene.
constexpr double kNearExtents = 4, kNearRadii = 2;

// Tuned on training cameras that were held out of workshop_ring and basketball.
constexpr double kDenseCameras = 27, kSparseCameras = 17;
constexpr double kDenseAngle = 14, kSparseAngle = 17;  // to the second nearest camera, degrees

double angle_between(const double a[3], const double b[3]) {
  double dot = 0, aa = 0, bb = 0;
  for (int k = 0; k < 3; ++k) {
    dot += a[k] * b[k];
    aa += a[k] * a[k];
    bb += b[k] * b[k];
  }
  if (!(aa > 0 && bb > 0)) return 0;
  return std::acos(std::clamp(dot / std::sqrt(aa * bb), -1.0, 1.0)) * 180 / std::numbers::pi;
}

// The angle to the second nearest other camera, or to the nearest of two.
double spacing(const std::vector<RigPose>& poses, std::size_t i, const double scene[3]) {
  std::vector<double> angles;
  for (std::size_t j = 0; j < poses.size(); ++j) {
    if (j != i) angles.push_back(rig_angle(poses[i], poses[j], scene));
  }
  std::sort(angles.begin(), angles.end());
  return angles[std::min<std::size_t>(1, angles.size() - 1)];
}

}  // namespace

RigPose rig_pose(const Camera& camera) {
  RigPose pose{};
  const double* r = camera.rotation;
  const double* t = camera.translation;
  for (int k = 0; k < 3; ++k) {
    pose.centre[k] = -(r[k] * t[0] + r[3 + k] * t[1] + r[6 + k] * t[2]);
    pose.forward[k] = r[6 + k];
  }
  return pose;
}

std::vector<RigPose> training_poses(const PreparedCapture& capture) {
  std::vector<RigPose> poses;
  for (const Camera& camera : capture.training_cameras()) poses.push_back(rig_pose(camera));
  return poses;
}

double rig_angle(const RigPose& a, const RigPose& b, const double scene[3]) {
  double from_a[3], from_b[3];
  for (int k = 0; k < 3; ++k) {
    from_a[k] = a.centre[k] - scene[k];
    from_b[k] = b.centre[k] - scene[k];
  }
  return std::max(angle_between(from_a, from_b), angle_between(a.forward, b.forward));
}

double rig_sparsity(const std::vector<RigPose>& poses, const double scene[3]) {
  if (poses.size() < 2) return 0;
  std::vector<double> angles;
  for (std::size_t i = 0; i < poses.size(); ++i) angles.push_back(spacing(poses, i, scene));
  const auto middle = angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2);
  std::nth_element(angles.begin(), middle, angles.end());
  const auto count = static_cast<double>(poses.size());
  const double few =
      std::clamp((kDenseCameras - count) / (kDenseCameras - kSparseCameras), 0.0, 1.0);
  return few * std::clamp((*middle - kDenseAngle) / (kSparseAngle - kDenseAngle), 0.0, 1.0);
}

double rig_sparsity(const PreparedCapture& capture) {
  return rig_sparsity(training_poses(capture), capture.scene_centre);
}

Vicinity vicinity_of(const PreparedCapture& capture) {
  const double* c = capture.scene_centre;
  return {{static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])},
          static_cast<float>(
              std::max(kNearExtents * capture.extent, kNearRadii * capture.scene_radius))};
}

}  // namespace stgs::encoder
