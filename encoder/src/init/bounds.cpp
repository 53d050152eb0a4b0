// SPDX-License-Identifier: Apache-2.0
#include "init/bounds.h"

#include <algorithm>
#include <cmath>

namespace stgs::encoder::init {
namespace {

// Content starts at the first percentile of the depths in a view. The near plane at half of that
// depth allows for motion towards the camera and excludes floaters in front of it.
constexpr double kNearPercentile = 0.01;
constexpr double kNearFraction = 0.5;

double quantile(std::vector<double>& values, double q) {
  const auto at = values.begin() + std::ptrdiff_t(q * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

void set_bounds(const std::vector<View>& views, std::vector<InitialPoint> points, double far,
                PreparedCapture* capture) {
  cv::Vec3d middle(0, 0, 0);
  for (const View& view : views) middle += view.centre * (1.0 / double(views.size()));
  double extent = 0;
  for (const View& view : views) extent = std::max(extent, cv::norm(view.centre - middle));
  if (extent > 0) capture->extent = float(1.1 * extent);  // as in 3D Gaussian Splatting
  if (far > 0) {
    std::erase_if(points, [&](const InitialPoint& point) {
      return cv::norm(position_of(point) - middle) > 0.5 * far;
    });
  }
  if (points.empty()) return;
  double nearest = 1e300;
  for (const View& view : views) {
    std::vector<double> depths;
    for (const InitialPoint& point : points) {
      const Pixel p = project(view, position_of(point));
      if (p.inside) depths.push_back(p.depth);
    }
    if (depths.size() >= 20) nearest = std::min(nearest, quantile(depths, kNearPercentile));
  }
  if (nearest < 1e300) capture->near_plane = float(kNearFraction * nearest);
  cv::Vec3d centre;
  std::vector<double> values(points.size());
  for (int k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = points[i].position[k];
    centre[k] = quantile(values, 0.5);
    capture->scene_centre[k] = centre[k];
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    values[i] = cv::norm(position_of(points[i]) - centre);
  }
  capture->scene_radius = std::max(1e-6, quantile(values, 0.95));
}

void drop_too_near(const std::vector<View>& views, float near_plane,
                   std::vector<InitialPoint>* points) {
  const auto too_near = [&](const InitialPoint& point) {
    return std::any_of(views.begin(), views.end(), [&](const View& view) {
      const Pixel p = project(view, position_of(point));
      return p.inside && p.depth < near_plane;
    });
  };
  points->erase(std::remove_if(points->begin(), points->end(), too_near), points->end());
}

}  // namespace stgs::encoder::init
