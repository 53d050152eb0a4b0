// SPDX-License-Identifier: Apache-2.0
#include "turntable.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "camera_axes.h"

namespace stgs::tools {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

// A rig whose largest gap between neighbours is smaller stands all around the scene.
constexpr double kMaxGap = 75 * std::numbers::pi / 180;
// Width of the window in which cameras determine height and distance, as a part of their arc.
constexpr double kWindow = 1.0 / 8;
constexpr double kMinWindow = 0.05;  // radians

constexpr int kIterations = 200;  // of the search for the vertical

// The direction of a vector, or `otherwise` for one without.
Vector3 direction_of(const Vector3& v, const Vector3& otherwise) {
  return length(v) > 1e-12 ? unit(v) : otherwise;
}

// A camera as seen from the centre of the scene, radians and scene units.
struct Station {
  double azimuth, elevation, distance;
};

class Path {
 public:
  explicit Path(const encoder::PreparedCapture& capture)
      : cameras_(capture.training_cameras()),
        centre_{capture.scene_centre[0], capture.scene_centre[1], capture.scene_centre[2]} {
    find_axes();
    for (const encoder::Camera& camera : cameras_) stations_.push_back(station_of(camera));
    std::sort(stations_.begin(), stations_.end(),
              [](const Station& a, const Station& b) { return a.azimuth < b.azimuth; });
    find_arc();
  }

  encoder::Camera at(double share) const {
    const double swing = whole_ ? kTurn * share : 0.5 * arc_ * std::sin(kTurn * share);
    const Station station = near(middle_ + swing);
    const Vector3 flat = std::cos(station.azimuth) * ahead_ + std::sin(station.azimuth) * side_;
    const Vector3 to_camera =
        std::cos(station.elevation) * flat + std::sin(station.elevation) * up_;
    return looking(to_camera, station.distance);
  }

 private:
  // The vertical is across the rows of all images, because cameras stand upright but look up or
  // down; where that leaves a choice, it is near the columns of the images, with which the search
  // begins. Ahead is towards the first camera.
  void find_axes() {
    Vector3 columns{};
    for (const encoder::Camera& camera : cameras_) columns = columns - axis_of(camera, 1);
    const Vector3 mean = direction_of(columns, {0, -1, 0});
    up_ = mean;
    for (int i = 0; i < kIterations; ++i) {  // power iteration for the smallest eigenvalue
      Vector3 next = static_cast<double>(cameras_.size()) * up_;
      for (const encoder::Camera& camera : cameras_) {
        const Vector3 row = axis_of(camera, 0);
        next = next - dot(row, up_) * row;
      }
      up_ = direction_of(next, mean);
    }
    const Vector3 to_first = position_of(cameras_.front()) - centre_;
    const Vector3 other = std::abs(up_.x) < 0.9 ? Vector3{1, 0, 0} : Vector3{0, 0, 1};
    ahead_ = direction_of(to_first - dot(to_first, up_) * up_,
                          direction_of(cross(up_, other), {0, 0, 1}));
    side_ = cross(up_, ahead_);
  }

  Station station_of(const encoder::Camera& camera) const {
    const Vector3 v = position_of(camera) - centre_;
    const double height = dot(v, up_), x = dot(v, ahead_), y = dot(v, side_);
    return {std::atan2(y, x), std::atan2(height, std::hypot(x, y)), length(v)};
  }

  // The arc is the turn without the largest gap between neighbours.
  void find_arc() {
    double gap = 0;
    for (std::size_t i = 0; i < stations_.size(); ++i) {
      const bool last = i + 1 == stations_.size();
      const double next = last ? stations_.front().azimuth + kTurn : stations_[i + 1].azimuth;
      if (next - stations_[i].azimuth < gap) continue;
      gap = next - stations_[i].azimuth;
      middle_ = next + 0.5 * (kTurn - gap);
    }
    whole_ = gap < kMaxGap;
    arc_ = whole_ ? kTurn : kTurn - gap;
  }

  // Height and distance at an azimuth, weighted means over the cameras.
  Station near(double azimuth) const {
    const double window = std::max(kWindow * arc_, kMinWindow);
    Station mean{azimuth, 0, 0};
    double weights = 0;
    for (const Station& station : stations_) {
      const double away = std::remainder(station.azimuth - azimuth, kTurn) / window;
      const double weight = std::exp(-0.5 * away * away) + 1e-6;
      mean.elevation += weight * station.elevation;
      mean.distance += weight * station.distance;
      weights += weight;
    }
    mean.elevation /= weights;
    mean.distance /= weights;
    return mean;
  }

  encoder::Camera looking(const Vector3& to_camera, double distance) const {
    encoder::Camera camera = cameras_.front();
    const Vector3 z = -1 * to_camera;
    const Vector3 x = direction_of(cross(z, up_), side_), y = cross(z, x);
    const Vector3 position = centre_ + distance * to_camera;
    const Vector3* axes[3] = {&x, &y, &z};
    for (std::size_t r = 0; r < 3; ++r) {
      const double row[3] = {axes[r]->x, axes[r]->y, axes[r]->z};
      std::copy_n(row, 3, camera.rotation + 3 * r);
      camera.translation[r] = -dot(*axes[r], position);
    }
    return camera;
  }

  std::vector<encoder::Camera> cameras_;
  std::vector<Station> stations_;  // by azimuth
  Vector3 centre_, up_{}, ahead_{}, side_{};
  double middle_ = 0, arc_ = 0;
  bool whole_ = false;
};

}  // namespace

std::vector<encoder::Camera> turntable(const encoder::PreparedCapture& capture, int count) {
  const Path path(capture);
  std::vector<encoder::Camera> views;
  for (int k = 0; k < count; ++k)
    views.push_back(path.at(static_cast<double>(k) / static_cast<double>(count)));
  return views;
}

}  // namespace stgs::tools
