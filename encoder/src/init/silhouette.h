// SPDX-License-Identifier: Apache-2.0
// The outline of the dynamic content in one view, and its relation to points and balls.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "init/view.h"

namespace stgs::encoder::init {

// The static surface of a view, which hides everything behind it.
struct Backdrop {
  // Level k holds the least and the greatest depth in blocks of 2^k x 2^k pixels, CV_32F. Unknown
  // depth is a large value.
  std::vector<cv::Mat> nearest, farthest;
};
// `depth`: CV_32F, scene units; pixels hide everything beyond it; 0: unknown.
Backdrop make_backdrop(const cv::Mat& depth);

struct Silhouette {
  View view;
  cv::Mat hiding;    // see geometry::VotingView; CV_32F
  cv::Mat integral;  // CV_32S integral image of the moving pixels, one pixel larger each way
  std::shared_ptr<const Backdrop> backdrop;  // at the size of the view; null: none

  bool shows_motion() const { return integral.at<int>(view.height, view.width) > 0; }
};
// Builds the integral image of the mask.
Silhouette make_silhouette(const View& view, const cv::Mat& mask,
                           std::shared_ptr<const Backdrop> backdrop);

// Where a view sees a point or all points of a ball:
//   kNotVisible  outside of the image, nearer than allowed or behind the static surface,
//   kOutside     beside the mask,
//   kInside      in the mask,
//   kNotInside   of a ball: one of the first two, which may differ between its points,
//   kUndecided   of a ball: any.
enum class Relation : std::uint8_t { kNotVisible, kOutside, kInside, kNotInside, kUndecided };

// Points nearer than `nearest`, which is above 0, are not visible.
Relation relation_of_point(const Silhouette& silhouette, const cv::Vec3d& point, double nearest);

// The relation that all points of a ball are known to have. Approximates the projected ball by a
// rectangle that contains it.
Relation relation_of_ball(const Silhouette& silhouette, const cv::Vec3d& centre, double radius,
                          double nearest);

}  // namespace stgs::encoder::init
