// SPDX-License-Identifier: Apache-2.0
// Epipolar lines of two calibrated views.
#pragma once

#include <opencv2/core.hpp>

#include "init/view.h"

namespace stgs::encoder::init {

// Returns the matrix F of y' F x = 0 for a point at x in view a and at y in view b (homogeneous,
// pixels), with a base line of length 1.
cv::Matx33d fundamental_of(const View& a, const View& b);

// Returns the distance of a match from its epipolar lines (Sampson), pixels; the first with a sign,
// which depends on the side.
double epipolar_offset(const cv::Matx33d& f, const cv::Point2d& p, const cv::Point2d& q);
double epipolar_distance(const cv::Matx33d& f, const cv::Point2d& p, const cv::Point2d& q);

}  // namespace stgs::encoder::init
