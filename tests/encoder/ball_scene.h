// SPDX-License-Identifier: Apache-2.0
// A ball that moves, in ten views around it.
#pragma once

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "init/hull.h"

namespace stgs::testing {

using encoder::init::make_silhouette;
using encoder::init::Silhouette;
using encoder::init::View;

inline constexpr int kViews = 10;
inline constexpr double kRing = 4, kBall = 0.4;
inline const cv::Vec3d kMiddle(0.3, -0.2, 0.1);

// A view from the ring, towards the origin.
inline View view_at(int k, int width = 320) {
  const double angle = 2 * CV_PI * k / kViews;
  const cv::Vec3d z(-std::cos(angle), 0, -std::sin(angle)), y(0, 1, 0), x = y.cross(z);
  View view;
  view.width = width;
  view.height = 3 * width / 4;
  view.fx = view.fy = 0.75 * width;
  view.cx = 0.5 * view.width;
  view.cy = 0.5 * view.height;
  view.rotation = cv::Matx33d(x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]);
  view.centre = -kRing * z;
  view.translation = -(view.rotation * view.centre);
  return view;
}

// The mask of the ball.
inline cv::Mat mask_in(const View& view) {
  cv::Mat mask(view.size(), CV_8U, cv::Scalar(0));
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const cv::Vec3d ray = cv::normalize(view.ray(x + 0.5, y + 0.5));
      const cv::Vec3d away = kMiddle - view.centre;
      if (cv::norm(away - away.dot(ray) * ray) < kBall) mask.at<std::uint8_t>(y, x) = 255;
    }
  }
  return mask;
}

// The silhouettes of the ball in front of a background at depth `behind` (0: unknown).
inline std::vector<Silhouette> silhouettes(double behind) {
  std::vector<Silhouette> out;
  for (int k = 0; k < kViews; ++k) {
    const View view = view_at(k);
    out.push_back(
        make_silhouette(view, mask_in(view), cv::Mat(view.size(), CV_32F, cv::Scalar(behind))));
  }
  return out;
}

// The depth at which the ray through a pixel meets the ball, or 0.
inline double ball_depth(const View& view, int x, int y) {
  const cv::Vec3d ray = view.ray(x + 0.5, y + 0.5), away = view.centre - kMiddle;
  const double a = ray.dot(ray), b = ray.dot(away), c = away.dot(away) - kBall * kBall;
  return b * b < a * c ? 0 : (-b - std::sqrt(b * b - a * c)) / a;
}

// An image of the ball, with texture, on grey.
inline cv::Mat image_in(const View& view) {
  cv::Mat image(view.size(), CV_8UC3, cv::Scalar::all(90));
  for (int y = 0; y < view.height; ++y) {
    for (int x = 0; x < view.width; ++x) {
      const double depth = ball_depth(view, x, y);
      if (depth == 0) continue;
      const cv::Vec3d p = view.at(x + 0.5, y + 0.5, depth);
      double value = 128;
      for (int k = 1; k <= 3; ++k) {
        const double f = 17.0 * k;
        value += 60 / k * std::sin(f * p[0] + k) * std::cos(f * p[1] + 2 * k) +
                 40 / k * std::sin(f * p[2] + 3 * k);
      }
      image.at<cv::Vec3b>(y, x) = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(value));
    }
  }
  return image;
}

}  // namespace stgs::testing
