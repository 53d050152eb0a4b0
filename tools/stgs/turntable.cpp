// SPDX-License-Identifier: Apache-2.0
#include "turntable.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace stgs::tools {
namespace {

using Vector = std::array<double, 3>;
constexpr double kTurn = 2 * std::numbers::pi;

// A rig whose largest gap between neighbours is smaller stands all around the scene.
constexpr double kMaxGap = 75 * std::numbers::pi / 180;
// Width of the window in which cameras determine height and distance, as a part of their arc.
constexpr double kWindow = 1.0 / 8;
constexpr double kMinWindow = 0.05;  // radians

constexpr int kIterations = 200;  // of the search for the vertical

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// `fallback` for a vector without direction.
Vector unit(const Vector& v, const Vector& fallback) {
  const double length = std::sqrt(dot(v, v));
  if (!(length > 1e-12)) return fallback;
  return {v[0] / length, v[1] / length, v[2] / length};
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
    const double c = std::cos(station.elevation);
    Vector to;  // from the centre to the camera
    for (std::size_t k = 0; k < 3; ++k) {
      to[k] = c * (std::cos(station.azimuth) * ahead_[k] + std::sin(station.azimuth) * side_[k]) +
              std::sin(station.elevation) * up_[k];
    }
    return looking(to, station.distance);
  }

 private:
  static Vector row(const encoder::Camera& camera, int r) {
    return {camera.rotation[3 * r], camera.rotation[3 * r + 1], camera.rotation[3 * r + 2]};
  }

  Vector from_centre(const encoder::Camera& camera) const {
    Vector v;
    for (std::size_t k = 0; k < 3; ++k) {
      double position = 0;
      for (std::size_t r = 0; r < 3; ++r)
        position -= camera.rotation[3 * r + k] * camera.translation[r];
      v[k] = position - centre_[k];
    }
    return v;
  }

  // The vertical is across the rows of all images, because cameras stand upright but look up or
  // down; where that leaves a choice, it is near the columns of the images, with which the search
  // begins. Ahead is towards the first camera.
  void find_axes() {
    Vector columns{};
    for (const encoder::Camera& camera : cameras_) {
      for (std::size_t k = 0; k < 3; ++k) columns[k] -= row(camera, 1)[k];
    }
    const Vector mean = unit(columns, {0, -1, 0});
    const auto count = static_cast<double>(cameras_.size());
    up_ = mean;
    for (int i = 0; i < kIterations; ++i) {  // power iteration for the smallest eigenvalue
      Vector next;
      for (std::size_t k = 0; k < 3; ++k) {
        next[k] = count * up_[k];
        for (const encoder::Camera& camera : cameras_)
          next[k] -= dot(row(camera, 0), up_) * row(camera, 0)[k];
      }
      up_ = unit(next, mean);
    }
    const Vector to = from_centre(cameras_.front());
    Vector flat;
    for (std::size_t k = 0; k < 3; ++k) flat[k] = to[k] - dot(to, up_) * up_[k];
    const Vector other = std::abs(up_[0]) < 0.9 ? Vector{1, 0, 0} : Vector{0, 0, 1};
    ahead_ = unit(flat, unit(cross(up_, other), {0, 0, 1}));
    side_ = cross(up_, ahead_);
  }

  Station station_of(const encoder::Camera& camera) const {
    const Vector v = from_centre(camera);
    const double height = dot(v, up_), x = dot(v, ahead_), y = dot(v, side_);
    return {std::atan2(y, x), std::atan2(height, std::hypot(x, y)), std::sqrt(dot(v, v))};
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

  encoder::Camera looking(const Vector& to, double distance) const {
    encoder::Camera camera = cameras_.front();
    const Vector z = {-to[0], -to[1], -to[2]};
    const Vector x = unit(cross(z, up_), side_), y = cross(z, x);
    const Vector* axes[3] = {&x, &y, &z};
    for (std::size_t r = 0; r < 3; ++r) {
      std::copy_n(axes[r]->begin(), 3, camera.rotation + 3 * r);
      camera.translation[r] = -dot(*axes[r], centre_) - distance * dot(*axes[r], to);
    }
    return camera;
  }

  std::vector<encoder::Camera> cameras_;
  std::vector<Station> stations_;  // by azimuth
  Vector centre_, up_{}, ahead_{}, side_{};
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
